//! Natural water and swimming pools.

use super::point::GroundPoint;
use crate::colour::{Rgb, rgb8, toned};
use crate::ground_noise::GroundNoise;
use crate::noise::fbm;
use crate::random::unit;

/// A river or lake with its shore.
pub(super) fn water(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let at = point.at;
    let seed = point.patch.seed;
    let shallow = (1.0 - at.depth / 4.0 + 0.5 * mid).clamp(0.0, 1.0);
    let deep = match seed & 3 {
        0 => rgb8(38, 54, 56),
        1 => rgb8(56, 66, 52),
        _ => rgb8(46, 58, 48),
    };
    if at.depth < 1.1 + 0.8 * mid {
        return (toned(rgb8(122, 112, 88), 1.0 + 0.2 * fine), 40);
    }
    let ripple = 1.0 + 0.05 * fine + 0.06 * mid;
    (toned(deep.mix(rgb8(92, 94, 66), shallow * 0.8), ripple), 41)
}

/// A swimming pool with its rim.
pub(super) fn pool(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let at = point.at;
    let seed = point.patch.seed;
    let p = point.p;
    if at.depth < 0.5 {
        return (rgb8(206, 200, 190), 42);
    }
    let ripple = 1.0 + 0.05 * (fbm(p.x * 60.0, p.y * 60.0)) * point.resolved(0.5);
    (
        toned(
            rgb8(70, 170, 190).mix(rgb8(52, 140, 180), unit(seed)),
            ripple,
        ),
        43,
    )
}
