//! The colour of the ground by kind of cover, each textured at several scales.

mod crop;
mod paved;
mod point;
mod sport;
mod vegetation;
mod water;

pub(crate) use point::GroundPoint;

use crate::colour::Rgb;
use crate::cover::Cover;

/// Linear colour of a ground point, and a number that differs between surfaces whose border is to be antialiased.
pub(crate) fn patch_albedo(point: &GroundPoint<'_>) -> (Rgb, u32) {
    match point.patch.cover {
        Cover::Lawn => vegetation::lawn(point),
        Cover::Meadow => vegetation::meadow(point),
        Cover::Crop => crop::field(point),
        Cover::Orchard => vegetation::orchard(point),
        Cover::ForestFloor => vegetation::forest_floor(point),
        Cover::Garden => vegetation::garden(point),
        Cover::Allotment => vegetation::allotment(point),
        Cover::Graves => vegetation::graves(point),
        Cover::Asphalt => paved::asphalt(point),
        Cover::Stalls => paved::parking(point),
        Cover::Concrete => paved::concrete(point),
        Cover::Slabs => paved::slabs(point),
        Cover::Gravel => paved::gravel(point),
        Cover::Dirt => paved::dirt(point),
        Cover::Sand => paved::sand(point),
        Cover::Ballast => paved::ballast(point),
        Cover::Site => paved::construction_site(point),
        Cover::Water => water::water(point),
        Cover::Pool => water::pool(point),
        Cover::Pitch => sport::pitch(point),
        Cover::Court => sport::court(point),
        Cover::Track => sport::running_track(point),
    }
}
