//! Why a calibration cannot be fitted.

/// Why a calibration cannot be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Too few right answers.
    #[error(
        "only {found} right answers; at least {needed} are required: use more photos, and check that the model localises at all"
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
    /// Too few right answers of one half of the scenes.
    #[error(
        "only {found} right answers of one half of the scenes; at least {needed} of each half are required, as the fit to one is checked \
         on the other: more scenes or more photos of each are needed"
    )]
    TooFewFixesOfHalf {
        /// How many there are.
        found: usize,
        /// How many there must be.
        needed: usize,
    },
    /// Too few photos taken elsewhere of one half of the scenes.
    #[error(
        "only {found} photos taken elsewhere of one half of the scenes; at least {needed} of each half are required, as the fit to one is \
         checked on the other"
    )]
    TooFewElsewhereOfHalf {
        /// How many there are.
        found: usize,
        /// How many there must be.
        needed: usize,
    },
}

impl FitError {
    /// The same of one half of the scenes.
    pub(super) fn of_half(self) -> Self {
        match self {
            Self::TooFewFixes { found, needed } => Self::TooFewFixesOfHalf { found, needed },
            Self::TooFewElsewhere { found, needed } => {
                Self::TooFewElsewhereOfHalf { found, needed }
            }
            of_half => of_half,
        }
    }
}
