//! The geometric relation of the two views of a pair.

use super::counterpart::Counterpart;
use super::homography::apply;
use super::rendered_place::RenderedPlace;
use nalgebra::Matrix3;
use std::sync::Arc;

/// The relation of the two views of a pair.
#[derive(Clone, Debug)]
pub enum Mapping {
    /// Both views are cut from one flat picture.
    Plane {
        /// From pixels of the map view to pixels of the drone view.
        uav_from_sat_px: Matrix3<f64>,
        /// Its inverse.
        sat_from_uav_px: Matrix3<f64>,
    },
    /// The views are cut from two renderings of a place with relief.
    Relief {
        /// The two renderings.
        place: Arc<RenderedPlace>,
        /// From pixels of the map view to pixels of the rendered map, and the inverse.
        map_from_sat_px: [Matrix3<f64>; 2],
        /// From pixels of the drone view to pixels of the rendered photo, and the inverse.
        photo_from_uav_px: [Matrix3<f64>; 2],
    },
    /// The views show one place, but corresponding points are not known.
    Unknown,
}

impl Mapping {
    /// The relation given by a homography; `None` if it is not invertible.
    pub fn plane(uav_from_sat_px: Matrix3<f64>) -> Option<Self> {
        Some(Self::Plane {
            uav_from_sat_px,
            sat_from_uav_px: uav_from_sat_px.try_inverse()?,
        })
    }

    /// Where a point of the map view is in the drone view, which is `side_px` square. Points nearer than `margin_px` to its
    /// edge count as outside.
    pub fn uav_from_sat(&self, at: [f64; 2], side_px: f64, margin_px: f64) -> Counterpart {
        let found = match self {
            Self::Plane {
                uav_from_sat_px, ..
            } => Counterpart::At(apply(uav_from_sat_px, at)),
            Self::Relief {
                place,
                map_from_sat_px,
                photo_from_uav_px,
            } => match place.uav_from_sat(apply(&map_from_sat_px[0], at)) {
                Counterpart::At(there) => Counterpart::At(apply(&photo_from_uav_px[1], there)),
                other => other,
            },
            Self::Unknown => Counterpart::Outside,
        };
        within(found, side_px, margin_px)
    }

    /// Where a point of the drone view is in the map view; as [`Mapping::uav_from_sat`].
    pub fn sat_from_uav(&self, at: [f64; 2], side_px: f64, margin_px: f64) -> Counterpart {
        let found = match self {
            Self::Plane {
                sat_from_uav_px, ..
            } => Counterpart::At(apply(sat_from_uav_px, at)),
            Self::Relief {
                place,
                map_from_sat_px,
                photo_from_uav_px,
            } => match place.sat_from_uav(apply(&photo_from_uav_px[0], at)) {
                Counterpart::At(there) => Counterpart::At(apply(&map_from_sat_px[1], there)),
                other => other,
            },
            Self::Unknown => Counterpart::Outside,
        };
        within(found, side_px, margin_px)
    }
}

/// A point outside the view becomes [`Counterpart::Outside`].
fn within(found: Counterpart, side_px: f64, margin_px: f64) -> Counterpart {
    let range = margin_px..=side_px - 1.0 - margin_px;
    match found {
        Counterpart::At([x, y]) if !(range.contains(&x) && range.contains(&y)) => {
            Counterpart::Outside
        }
        other => other,
    }
}
