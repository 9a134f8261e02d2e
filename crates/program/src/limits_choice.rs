//! Options that change the limits on untrusted input.

use clap::Args;
use grimnet_limits::{Limits, PhotoLimits};

use crate::values;

/// The limits that a user may change.
#[derive(Debug, Clone, Args)]
pub struct LimitsChoice {
    /// Refuse photos that need more memory than this to be read and decoded, MiB
    #[arg(
        long,
        value_name = "MIB",
        value_parser = values::memory_mib,
        allow_hyphen_values = true,
        default_value_t = PhotoLimits::DEFAULT.max_memory_bytes >> 20,
        help_heading = "Limits"
    )]
    max_photo_memory: u64,
}

impl LimitsChoice {
    /// All limits, with those that were chosen.
    pub fn limits(&self) -> Limits {
        let mut limits = Limits::default();
        limits.photo.max_memory_bytes = self.max_photo_memory << 20;
        limits
    }
}
