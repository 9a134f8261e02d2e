//! Telemetry that a flight goes without.

use grimnet_track::Input;

/// The kinds of telemetry that a flight goes without because fixes contradicted them: [`crate::Flight::left_out_now`],
/// [`crate::Flight::left_out`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LeftOut {
    /// Attitude: yaw or tilt was wrong.
    pub attitude: bool,
    /// Height.
    pub height: bool,
    /// Velocity.
    pub velocity: bool,
}

impl LeftOut {
    /// Whether an input is of a kind that is left out.
    #[must_use]
    pub fn contains(self, input: &Input) -> bool {
        match input {
            Input::Attitude(_) => self.attitude,
            Input::Height(_) => self.height,
            Input::Velocity(_) => self.velocity,
            _ => false,
        }
    }
}
