//! The velocity that a hypothesis's velocity is relative to.

use nalgebra::Vector2;

/// What the reference velocity is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReferenceKind {
    /// Zero: nothing measures the velocity.
    Free,
    /// The autopilot's velocity.
    Velocity,
    /// Motion between frames.
    Motion,
}

/// The velocity that the state's velocity components are relative to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reference {
    pub kind: ReferenceKind,
    /// Metres per second east, north.
    pub velocity_m_s: Vector2<f64>,
    /// When it was measured, seconds.
    pub time_s: f64,
    /// Size of its error, metres per second.
    pub sigma_m_s: f64,
}

impl Reference {
    pub const FREE: Self = Self {
        kind: ReferenceKind::Free,
        velocity_m_s: Vector2::new(0.0, 0.0),
        time_s: 0.0,
        sigma_m_s: 0.0,
    };
}
