//! Sports grounds.

use super::point::GroundPoint;
use crate::colour::{Rgb, rgb8, toned};
use crate::grass::grass;
use crate::ground_noise::GroundNoise;

/// A football pitch with its markings.
pub(super) fn pitch(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundPoint {
        patch,
        at,
        noise,
        season,
        ..
    } = *point;
    let h = patch.half;
    let l = at.local;
    let c = l.abs();
    let mown = if ((l.x / 5.5).floor() as i32) & 1 == 0 {
        0.07
    } else {
        -0.07
    };
    let worn = ((0.35 - ((c.x - h.x + 6.0) / 9.0).hypot(l.y / 7.0) * 0.3) + 0.3 * noise.mid)
        .clamp(0.0, 0.55);
    let g = grass(season, 0.75 + 0.3 * noise.coarse + 0.25 * noise.mid + mown);
    let ground = toned(
        g.mix(rgb8(150, 128, 92), worn),
        1.0 + mown * 0.5 + 0.1 * noise.fine,
    );
    let line = |d: f32| d.abs() < 0.09;
    let (ex, ey) = (h.x - 2.0, h.y - 2.0);
    let in_field = c.x < ex + 0.1 && c.y < ey + 0.1;
    let ring = l.norm();
    let box_x = c.x - (ex - 16.5);
    let marked = in_field
        && (line(c.x - ex)
            || line(c.y - ey)
            || line(l.x)
            || line(ring - 9.15)
            || line(box_x) && c.y < 20.15
            || line(c.y - 20.15) && box_x > 0.0);
    let albedo = if marked {
        ground.mix(rgb8(230, 232, 226), 0.8)
    } else {
        ground
    };
    (albedo, 44 + u32::from(at.depth < 1.0))
}

/// A tennis or basketball court with its markings.
pub(super) fn court(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundNoise { fine, mid, .. } = *point.noise;
    let patch = point.patch;
    let local = point.at.local;
    let seed = point.patch.seed;
    let h = patch.half;
    let c = local.abs();
    let line = (c.x - (h.x - 3.0)).abs() < 0.07 && c.y < h.y - 2.0
        || (c.y - (h.y - 2.0)).abs() < 0.07 && c.x < h.x - 3.0
        || c.x < 0.07 && c.y < h.y - 2.0
        || (c.y - (h.y - 4.4)).abs() < 0.06 && c.x < h.x - 3.0;
    let (inner, outer) = match seed & 3 {
        0 => (rgb8(156, 84, 64), rgb8(86, 116, 84)),
        1 => (rgb8(62, 98, 140), rgb8(78, 124, 92)),
        2 => (rgb8(72, 116, 86), rgb8(150, 86, 66)),
        _ => (rgb8(176, 108, 74), rgb8(176, 108, 74)),
    };
    let playing = c.x < h.x - 3.0 && c.y < h.y - 2.0;
    let tone = 1.0 + 0.06 * fine + 0.08 * mid;
    if line {
        (rgb8(226, 226, 222), 46)
    } else {
        (
            toned(if playing { inner } else { outer }, tone),
            47 + u32::from(playing),
        )
    }
}

/// A running track with six lanes round a lawn.
pub(super) fn running_track(point: &GroundPoint<'_>) -> (Rgb, u32) {
    let GroundPoint {
        patch,
        noise,
        season,
        ..
    } = *point;
    let local = point.at.local;
    // A stadium shape: straights along u, half circles at the ends, six lanes.
    let radius = patch.half.y;
    let straight = (patch.half.x - radius).max(0.0);
    let over = (local.x.abs() - straight).max(0.0);
    let r = over.hypot(local.y);
    let inner = radius - 7.4;
    if r < inner || r > radius {
        let lush = 0.6 + 0.4 * noise.mid + 0.3 * noise.coarse;
        return (
            toned(grass(season, lush), 1.0 + 0.1 * noise.fine),
            56 + u32::from(r > radius),
        );
    }
    let lane = (r - inner).rem_euclid(1.22);
    let colour = if patch.seed & 3 == 0 {
        rgb8(88, 104, 150)
    } else {
        rgb8(164, 84, 66)
    };
    if lane < 0.08 || local.x.abs() < 0.1 && local.y > 0.0 {
        return (rgb8(216, 206, 198), 58);
    }
    (
        toned(colour, 1.0 + 0.06 * noise.fine + 0.08 * noise.mid),
        59,
    )
}
