//! Where a point of one view of a pair lies in the other.

use super::homography::apply;
use super::piece::Piece;
use nalgebra::Matrix3;
use std::sync::Arc;

/// What became of a point in the other view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// It lies there, pixels (x, y), pixel centres at integers.
    At([f64; 2]),
    /// It lies outside the other view.
    Outside,
    /// Something else stands in front of it, or it is no longer there.
    Hidden,
}

impl Seen {
    /// The point, where it is seen.
    pub fn at(self) -> Option<[f64; 2]> {
        match self {
            Self::At(at) => Some(at),
            Self::Outside | Self::Hidden => None,
        }
    }
}

/// The exact relation of the two views of a pair.
#[derive(Clone, Debug)]
pub enum Mapping {
    /// Both views are taken from one flat picture.
    Plane {
        /// From the map's view's pixels to the drone's view's.
        uav_from_sat_px: Matrix3<f64>,
        /// Back.
        sat_from_uav_px: Matrix3<f64>,
    },
    /// The views are cut from two pictures of a place with relief.
    Relief {
        /// The two pictures.
        piece: Arc<Piece>,
        /// From the map's view's pixels to the map picture's, and back.
        piece_from_sat_px: [Matrix3<f64>; 2],
        /// From the drone's view's pixels to the photo's, and back.
        piece_from_uav_px: [Matrix3<f64>; 2],
    },
}

impl Mapping {
    /// A plane's; `None` where the homography cannot be inverted.
    pub fn plane(uav_from_sat_px: Matrix3<f64>) -> Option<Self> {
        Some(Self::Plane {
            uav_from_sat_px,
            sat_from_uav_px: uav_from_sat_px.try_inverse()?,
        })
    }

    /// Where a point of the map's view lies in the drone's view, `side_px` square, at least `margin_px` from its edge.
    pub fn uav_from_sat(&self, at: [f64; 2], side_px: f64, margin_px: f64) -> Seen {
        let found = match self {
            Self::Plane {
                uav_from_sat_px, ..
            } => Seen::At(apply(uav_from_sat_px, at)),
            Self::Relief {
                piece,
                piece_from_sat_px,
                piece_from_uav_px,
            } => match piece.uav_from_sat(apply(&piece_from_sat_px[0], at)) {
                Seen::At(there) => Seen::At(apply(&piece_from_uav_px[1], there)),
                other => other,
            },
        };
        within(found, side_px, margin_px)
    }

    /// Where a point of the drone's view lies in the map's view; as [`Mapping::uav_from_sat`].
    pub fn sat_from_uav(&self, at: [f64; 2], side_px: f64, margin_px: f64) -> Seen {
        let found = match self {
            Self::Plane {
                sat_from_uav_px, ..
            } => Seen::At(apply(sat_from_uav_px, at)),
            Self::Relief {
                piece,
                piece_from_sat_px,
                piece_from_uav_px,
            } => match piece.sat_from_uav(apply(&piece_from_uav_px[0], at)) {
                Seen::At(there) => Seen::At(apply(&piece_from_sat_px[1], there)),
                other => other,
            },
        };
        within(found, side_px, margin_px)
    }
}

/// A point outside the view becomes [`Seen::Outside`].
fn within(found: Seen, side_px: f64, margin_px: f64) -> Seen {
    let range = margin_px..=side_px - 1.0 - margin_px;
    match found {
        Seen::At([x, y]) if !(range.contains(&x) && range.contains(&y)) => Seen::Outside,
        other => other,
    }
}
