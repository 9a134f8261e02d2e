//! Keypoint and matching figures of one pair.

use super::homography_estimate::{mutual_matches, ransac};
use crate::data::{Pair, apply};
use grimnet_net::Features;
use rand_chacha::ChaCha8Rng;

/// Two points nearer to each other than this are the same, pixels.
const SAME_PX: f64 = 3.0;

/// Figures of one pair.
pub(super) struct PairFigures {
    /// Share of the keypoints of the shared area that the other view has, too.
    pub(super) repeatability: f64,
    /// Correct matches per keypoint of the shared area.
    pub(super) matching_score: f64,
    /// Number of correct matches.
    pub(super) correct: usize,
    /// Number of matches.
    pub(super) matched: usize,
    /// Mean distance of the corners after the estimated and the true homography, pixels.
    pub(super) corner_error_px: f64,
}

/// Compares the features of both views with the true relation of the views.
pub(super) fn pair_figures(
    pair: &Pair,
    sat: &Features,
    uav: &Features,
    random: &mut ChaCha8Rng,
) -> PairFigures {
    let side = f64::from(pair.sat.width());
    let h = &pair.uav_from_sat_px;
    let at = |f: &Features| {
        f.keypoints
            .iter()
            .map(|k| [f64::from(k.x_px), f64::from(k.y_px)])
            .collect::<Vec<_>>()
    };
    let (a, b) = (at(sat), at(uav));
    let cells = side as usize / 8;
    let seen = |[x, y]: [f64; 2]| {
        let inside = (0.0..side - 1.0).contains(&x) && (0.0..side - 1.0).contains(&y);
        inside && pair.uav_seen[(y as usize / 8) * cells + x as usize / 8]
    };
    // A point that is not visible in the other view is near none of its points.
    let mapped: Vec<[f64; 2]> = a
        .iter()
        .map(|p| pair.mapping.uav_from_sat(*p, side, 0.0).at())
        .map(|at| at.unwrap_or([f64::INFINITY; 2]))
        .collect();
    let shared: Vec<usize> = (0..a.len()).filter(|i| seen(mapped[*i])).collect();
    let near = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]) < SAME_PX;
    let repeated = shared
        .iter()
        .filter(|i| b.iter().any(|q| near(mapped[**i], *q)))
        .count();
    let d = sat.descriptor_dim;
    let matches = mutual_matches(&sat.descriptors, &uav.descriptors, d);
    let correct = matches
        .iter()
        .filter(|(i, j)| near(mapped[*i], b[*j]))
        .count();
    let estimate = ransac(
        &matches
            .iter()
            .map(|(i, j)| (a[*i], b[*j]))
            .collect::<Vec<_>>(),
        random,
    );
    let corners = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]];
    let corner_error_px = estimate.map_or(f64::MAX, |estimate| {
        let error = |p: [f64; 2]| {
            let (u, v) = (apply(&estimate, p), apply(h, p));
            (u[0] - v[0]).hypot(u[1] - v[1])
        };
        corners.into_iter().map(error).sum::<f64>() / 4.0
    });
    let count = shared.len().max(1) as f64;
    PairFigures {
        repeatability: repeated as f64 / count,
        matching_score: correct as f64 / count,
        correct,
        matched: matches.len(),
        corner_error_px,
    }
}
