//! How many photos a calibration localises.

use std::iter::Sum;
use std::ops::Add;

use super::{FitError, confidence};

/// Photos that are localised, by what is right for them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PhotoCount {
    /// On their own map.
    pub here: usize,
    /// On the map of another place, where no answer is right.
    pub elsewhere: usize,
}

impl PhotoCount {
    /// Checks that a calibration can be fitted to them if every answer is right.
    ///
    /// # Errors
    /// Too few of either.
    pub fn check_enough(self) -> Result<(), FitError> {
        // The figures on held-out scenes come from fits to each half.
        confidence::check_enough(self.here / 2, self.elsewhere / 2).map_err(FitError::of_half)
    }
}

impl Add for PhotoCount {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            here: self.here + other.here,
            elsewhere: self.elsewhere + other.elsewhere,
        }
    }
}

impl Sum for PhotoCount {
    fn sum<I: Iterator<Item = Self>>(counts: I) -> Self {
        counts.fold(Self::default(), Add::add)
    }
}
