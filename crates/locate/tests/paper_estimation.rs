//! The estimation of paper mode: RANSAC-DLT and the weighted refinement of the publication, without the checks of default mode.

#![allow(clippy::unwrap_used)]

use grimnet_locate::{
    Options,
    internals::{
        correspondence::Correspondence,
        covariance::mapped_point_covariance,
        estimation::{EstimationOptions, GeometryModel, estimate},
        homography::Homography,
        sampler::Sampling,
        transform::Transform,
    },
};
use nalgebra::{Matrix3, Point2};

#[test]
fn the_papers_estimation_is_uniform_unchecked_and_keeps_four_inliers() {
    let options = Options::paper().estimation(f64::INFINITY);
    assert_eq!(
        (options.model, options.sampling, options.refine),
        (GeometryModel::PlainHomography, Sampling::Uniform, true)
    );
    let ransac = options.ransac;
    assert_eq!((ransac.threshold_px, ransac.max_iterations), (4.0, 1000));
    assert!(!ransac.local_optimisation && !ransac.needs_support);
    // Four pairs of a mirroring homography and two that fit nothing: the checked estimation finds no homography.
    let mirror = Homography::from_matrix(Matrix3::new(
        -1.0, 0.1, 300.0, 0.0, 1.0, 9.0, 1e-4, 0.0, 1.0,
    ));
    let mirror = mirror.unwrap();
    let mut pairs: Vec<Correspondence> =
        [[20.0, 30.0], [290.0, 40.0], [280.0, 300.0], [15.0, 270.0]]
            .map(|[x, y]| {
                let from = Point2::new(x, y);
                Correspondence::weighted(from, mirror.map(from).unwrap(), 0.5)
            })
            .to_vec();
    for (from, to) in [
        ([100.0, 60.0], [310.0, 1500.0]),
        ([200.0, 220.0], [20.0, 2900.0]),
    ] {
        pairs.push(Correspondence::new(from.into(), to.into()));
    }
    let found = estimate(&pairs, &options).unwrap();
    assert_eq!(found.inliers.len(), 4);
    let centre = Point2::new(160.0, 160.0);
    let inliers: Vec<_> = found.inliers.iter().map(|&i| pairs[i]).collect();
    assert!(mapped_point_covariance(&found.homography, &inliers, centre, 0.4).is_some());
    let checked = EstimationOptions {
        model: GeometryModel::Homography,
        ransac: Options::default().ransac,
        ..options
    };
    assert!(estimate(&pairs, &checked).is_none());
    // The paper's refinement weighs by probability and keeps the inliers that it was made on.
    let off = EstimationOptions {
        refine: false,
        ..options
    };
    let noisy: Vec<Correspondence> = (0..40)
        .map(|i| {
            let i = f64::from(i);
            let from = Point2::new((37.0 * i) % 320.0, (91.0 * i) % 320.0);
            let shift = if (i as u32).is_multiple_of(2) {
                1.5
            } else {
                -1.5
            };
            let weight = if (i as u32).is_multiple_of(2) {
                1.0
            } else {
                1e-6
            };
            Correspondence::weighted(from, Point2::new(from.x + shift, from.y), weight)
        })
        .collect();
    let [refined, plain] = [options, off].map(|options| estimate(&noisy, &options).unwrap());
    assert_eq!(refined.inliers, plain.inliers);
    let moved = refined.homography.map(centre).unwrap().x - centre.x;
    assert!(
        (moved - 1.5).abs() < 0.01,
        "{moved}: the heavy pairs decide"
    );
    assert!((plain.homography.map(centre).unwrap().x - centre.x - 1.5).abs() > 0.01);
}
