//! How a picture is turned to be upright.

use image::RgbImage;
use image::imageops::{rotate90, rotate180, rotate270};

/// By quarters of a turn, as cameras write it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rotation {
    None,
    Clockwise90,
    Half,
    Clockwise270,
}

impl Rotation {
    /// From a, b, c and d of a track's matrix, where x' = a x + c y and y' = b x + d y (ISO/IEC 14496-12, 8.3.2).
    pub(crate) fn of_matrix(matrix: [i32; 4]) -> Self {
        match matrix.map(i32::signum) {
            [0, 1, -1, 0] => Self::Clockwise90,
            [-1, 0, 0, -1] => Self::Half,
            [0, -1, 1, 0] => Self::Clockwise270,
            _ => Self::None,
        }
    }

    /// The picture turned.
    pub(crate) fn upright(self, picture: RgbImage) -> RgbImage {
        match self {
            Self::None => picture,
            Self::Clockwise90 => rotate90(&picture),
            Self::Half => rotate180(&picture),
            Self::Clockwise270 => rotate270(&picture),
        }
    }
}
