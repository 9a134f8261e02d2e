//! An input on its way.

use crate::input::Input;

/// An input and when it arrives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivered {
    /// Seconds.
    pub arrival_s: f64,
    /// The input.
    pub input: Input,
}
