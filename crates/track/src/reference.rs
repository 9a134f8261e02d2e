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
    /// When it was measured, seconds. Where nothing measures the velocity: the end of the latest motion between frames.
    pub time_s: f64,
    /// Size of its slowly changing error, metres per second.
    pub sigma_m_s: f64,
    /// What of it comes from the surface that is seen, which may move itself, metres per second.
    pub surface_m_s: f64,
    /// Variance per axis of the rest of its error, square metres per square second: a displacement over a short time tells the
    /// velocity poorly.
    pub variance_m2_s2: f64,
}

impl Reference {
    pub const FREE: Self = Self {
        kind: ReferenceKind::Free,
        velocity_m_s: Vector2::new(0.0, 0.0),
        time_s: f64::NEG_INFINITY,
        sigma_m_s: 0.0,
        surface_m_s: 0.0,
        variance_m2_s2: 0.0,
    };
}
