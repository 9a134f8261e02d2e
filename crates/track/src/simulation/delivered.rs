//! An input on its way.

use serde::{Deserialize, Serialize};

use crate::input::Input;

/// An input and when it arrives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Delivered {
    /// Seconds.
    pub arrival_s: f64,
    /// The input.
    pub input: Input,
}
