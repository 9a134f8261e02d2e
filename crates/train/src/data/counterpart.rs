//! Where a point of one view is in the other.

/// The counterpart of a point in the other view of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Counterpart {
    /// Visible at this pixel (x, y); pixel centres at integers.
    At([f64; 2]),
    /// Outside the other view, or not known.
    Outside,
    /// Occluded in the other view, or no longer there.
    Hidden,
}

impl Counterpart {
    /// The pixel; `None` if the point is not visible.
    pub fn at(self) -> Option<[f64; 2]> {
        match self {
            Self::At(at) => Some(at),
            Self::Outside | Self::Hidden => None,
        }
    }
}
