//! By how much a picture is reduced.

/// The size at which a picture is decoded, relative to its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reduction {
    /// 1/2 in width and height.
    Half,
    /// 1/4.
    Quarter,
    /// 1/8.
    Eighth,
}

impl Reduction {
    /// The smallest size with a long side of at least `min_long_side_px`; `None` if that is the full size.
    #[must_use]
    pub fn to_long_side((width_px, height_px): (u32, u32), min_long_side_px: u32) -> Option<Self> {
        let long_px = width_px.max(height_px);
        [Self::Eighth, Self::Quarter, Self::Half]
            .into_iter()
            .find(|reduction| long_px / reduction.divisor() >= min_long_side_px.max(1))
    }

    /// 2, 4 or 8.
    #[must_use]
    pub fn divisor(self) -> u32 {
        match self {
            Self::Half => 2,
            Self::Quarter => 4,
            Self::Eighth => 8,
        }
    }

    /// The reduced size of a picture, px, rounded up: the last column and row may lie partly beyond the picture.
    #[must_use]
    pub fn size_px(self, (width_px, height_px): (u32, u32)) -> (u32, u32) {
        let divisor = self.divisor();
        (width_px.div_ceil(divisor), height_px.div_ceil(divisor))
    }

    /// Side of what becomes of a block of 8 x 8 pixels.
    pub(crate) fn px_of_block(self) -> u32 {
        8 / self.divisor()
    }
}
