//! Options that change the limits on untrusted input.

use clap::Args;
use grimnet_limits::PhotoLimits;

use crate::values;

/// The limits that a user may change.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct LimitsChoice {
    /// Refuse photos that need more memory than this to be read and decoded, MiB [default: 1024; 512 for those that clients of
    /// `grim serve` send]
    #[arg(
        long,
        value_name = "MIB",
        value_parser = values::memory_mib,
        allow_hyphen_values = true,
        help_heading = "Limits"
    )]
    max_photo_memory: Option<u64>,
}

impl LimitsChoice {
    /// The limits on a photo: those chosen, else the default ones.
    #[must_use]
    pub fn photo(self) -> PhotoLimits {
        self.photo_or(PhotoLimits::DEFAULT)
    }

    /// The limits on a photo: those chosen, else `default`.
    #[must_use]
    pub fn photo_or(self, default: PhotoLimits) -> PhotoLimits {
        self.max_photo_memory
            .map_or(default, |mib| PhotoLimits::of_memory(mib << 20))
    }
}
