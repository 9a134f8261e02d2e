//! The stated covariance against what repeated trials scatter.

#![allow(clippy::unwrap_used)]

use grimnet_locate::internals::{
    correspondence::Correspondence,
    covariance::{mapped_point_covariance, propagate, radius, radius95},
    homography::Homography,
    refine::refine,
    similarity::Similarity,
    transform::Transform,
};
use nalgebra::{Matrix2, Matrix3, Point2, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A standard normal pair (Box & Muller 1958).
fn normal(rng: &mut ChaCha8Rng) -> Vector2<f64> {
    let (u, v): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random());
    let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
    Vector2::new(cos, sin) * (-2.0 * u.ln()).sqrt()
}

fn compare<const N: usize, T: Transform<N>>(
    truth: &T,
    fit: impl Fn(&[Correspondence]) -> T,
    seed: u64,
) {
    const TRIALS: usize = 4000;
    const NOISE_PX: f64 = 1.3;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // All in one half of the picture, unequal weights: an elongated covariance at a centre that lies outside the points.
    let points: Vec<(Point2<f64>, f64)> = (0..30)
        .map(|_| {
            (
                Point2::new(rng.random_range(0.0..180.0), rng.random_range(0.0..400.0)),
                rng.random_range(0.05..1.0),
            )
        })
        .collect();
    let centre = Point2::new(256.0, 256.0);
    let (mut scatter, mut stated, mut covered) = (Matrix2::zeros(), Matrix2::zeros(), 0);
    for _ in 0..TRIALS {
        let pairs: Vec<_> = points
            .iter()
            .map(|&(p, weight)| {
                Correspondence::weighted(
                    p,
                    truth.map(p).unwrap() + normal(&mut rng) * NOISE_PX,
                    weight,
                )
            })
            .collect();
        let model = refine(&fit(&pairs), &pairs).unwrap().model;
        let off = model.map(centre).unwrap() - truth.map(centre).unwrap();
        let covariance = mapped_point_covariance(&model, &pairs, centre, 0.1).unwrap();
        scatter += off * off.transpose() / TRIALS as f64;
        stated += covariance / TRIALS as f64;
        covered += usize::from(off.norm() <= radius95(&covariance));
    }
    // The standard error of a variance from 4000 trials is 2.2 %.
    let difference = (scatter - stated).norm() / scatter.norm();
    assert!(difference < 0.1, "scatter {scatter} stated {stated}");
    let share = covered as f64 / TRIALS as f64;
    assert!(
        (0.92..0.97).contains(&share),
        "{share} of the trials within the 95 % radius"
    );
}

#[test]
fn covariance_of_a_similarity_is_what_trials_scatter() {
    let truth = Similarity {
        a: 0.9,
        b: 0.3,
        tx: 10.0,
        ty: 20.0,
    };
    compare(&truth, |pairs| Similarity::fit(pairs).unwrap(), 1);
}

#[test]
fn covariance_of_a_homography_is_what_trials_scatter() {
    let truth = Homography::from_matrix(Matrix3::new(
        0.9, -0.3, 10.0, 0.3, 0.9, 20.0, 1e-4, -5e-5, 1.0,
    ))
    .unwrap();
    compare(&truth, |pairs| Homography::fit(pairs).unwrap(), 2);
}

#[test]
fn radius95_holds_95_percent() {
    // Quantiles of the chi distribution: two degrees of freedom, one degree of freedom.
    assert!((radius95(&Matrix2::identity()) - 2.447_746_830_680_816).abs() < 1e-9);
    assert!(
        (radius95(&Matrix2::new(4.0, 0.0, 0.0, 0.0)) - 2.0 * 1.959_963_984_540_054).abs() < 1e-6
    );
    assert!(
        (radius95(&Matrix2::new(2.0, 2.0, 2.0, 2.0)) - 2.0 * 1.959_963_984_540_054).abs() < 1e-6
    );
    // Half of a circle within sqrt(2 ln 2) sigma, of a needle within 0.6745 sigma.
    assert!((radius(&Matrix2::identity(), 0.5) - 1.177_410_022_515_475).abs() < 1e-9);
    assert!((radius(&Matrix2::new(1.0, 0.0, 0.0, 0.0), 0.5) - 0.674_489_750).abs() < 1e-4);
    assert_eq!(radius95(&Matrix2::zeros()), 0.0);
    assert!(radius95(&Matrix2::new(f64::NAN, 0.0, 0.0, 1.0)).is_nan());
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for ratio in [0.9, 0.5, 0.2, 0.05] {
        let shape = Matrix2::new(0.8, -0.6, 0.6, 0.8)
            * Matrix2::from_diagonal(&Vector2::new(3.0, 3.0 * ratio));
        let radius = radius95(&propagate(&Matrix2::identity(), &shape));
        let inside = (0..200_000)
            .filter(|_| (shape * normal(&mut rng)).norm() <= radius)
            .count();
        assert!(
            (inside as f64 / 200_000.0 - 0.95).abs() < 0.002,
            "{ratio}: {inside}"
        );
    }
}

#[test]
fn too_few_pairs_have_no_covariance() {
    let at = |x: f64, y: f64| Correspondence::new(Point2::new(x, y), Point2::new(x, y));
    let model = Similarity {
        a: 1.0,
        b: 0.0,
        tx: 0.0,
        ty: 0.0,
    };
    let centre = Point2::new(1.0, 1.0);
    assert!(mapped_point_covariance(&model, &[at(0.0, 0.0)], centre, 0.4).is_none());
    // Two pairs fit exactly; the covariance is then that of keypoints' least error alone.
    let two = [at(0.0, 0.0), at(2.0, 2.0)];
    let midway = mapped_point_covariance(&model, &two, centre, 0.4).unwrap();
    assert!((midway[(0, 0)] - 0.16 / 2.0).abs() < 1e-9, "{midway}");
    assert!(mapped_point_covariance(&model, &[at(5.0, 5.0); 9], centre, 0.4).is_none());
    // Perfect agreement is still not believed.
    let perfect: Vec<_> = (0..25)
        .map(|i| at(f64::from(i % 5) * 90.0, f64::from(i / 5) * 90.0))
        .collect();
    let covariance =
        mapped_point_covariance(&model, &perfect, Point2::new(180.0, 180.0), 0.41).unwrap();
    assert!((covariance[(0, 0)] - 0.41f64.powi(2) / 25.0).abs() < 1e-9);
}
