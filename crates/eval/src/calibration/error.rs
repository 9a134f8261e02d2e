//! Why a calibration cannot be fitted.

/// Why a calibration cannot be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Too few right answers.
    #[error(
        "only {found} right answers; at least {needed} are required: check that the model localises at all"
    )]
    TooFewFixes {
        /// How many there are.
        found: usize,
        /// How many there must be.
        needed: usize,
    },
    /// Too few photos taken elsewhere.
    #[error("only {found} photos taken elsewhere; at least {needed} are required")]
    TooFewElsewhere {
        /// How many there are.
        found: usize,
        /// How many there must be.
        needed: usize,
    },
}
