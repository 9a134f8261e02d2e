//! How a simulated camera is carried.

/// How the camera is carried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Camera {
    /// Fixed to the aircraft: it leans with it.
    Fixed,
    /// Kept level by a gimbal, but for small errors.
    Gimbal,
}
