//! Calibration: what is fitted holds on what was not seen, and radii that are halved are found out.

#![allow(clippy::unwrap_used)]

use grimnet_eval::calibration::confidence::ELSEWHERE_ANSWERED;
use grimnet_eval::calibration::observation::{self, Answer, Observation};
use grimnet_eval::calibration::{Check, FitError, confidence, fit, position};
use grimnet_locate::Support;
use grimnet_net::{Calibration, PositionError};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A normal deviate (Box & Muller 1958).
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * rng.random_range(f64::MIN_POSITIVE..1.0).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

const GSD_M: f64 = 0.3;

/// How the made-up localiser errs: its inliers' covariance is 6 times too small, and 0.8 px are shared.
const TRUE_ERROR: PositionError = PositionError {
    inlier_factor: 6.0,
    shared_px: 0.8,
};

/// Photos of a made-up localiser: right ones have some tens of inliers, those taken elsewhere few and a close runner-up.
fn observations(count: usize, seed: u64) -> Vec<Observation> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut all = Vec::new();
    for i in 0..count {
        let scene = i % 6;
        let sigma_m = rng.random_range(0.05..0.5);
        let inliers = (25.0 + 60.0 * rng.random::<f64>()) as usize;
        let off = (TRUE_ERROR.inlier_factor * f64::powi(sigma_m, 2)
            + (TRUE_ERROR.shared_px * GSD_M).powi(2))
        .sqrt();
        let answer = |error_m: f64, inliers, runner_up_inliers, rng: &mut ChaCha8Rng| Answer {
            error_east_m: error_m * normal(rng),
            error_north_m: error_m * normal(rng),
            level_gsd_m: GSD_M,
            support: Support {
                held_back_points: 100,
                held_back_excess: 0.0,
                expected_inliers: 0.5,
                on_map: 1.0,
                inliers,
                places: inliers,
                matches: 150,
                runner_up_inliers,
                spread: rng.random_range(0.2..0.5),
                inlier_covariance_en_m2: [sigma_m.powi(2), 0.0, sigma_m.powi(2)],
            },
        };
        let right = answer(off, inliers, 7, &mut rng);
        let chance = 6 + (2.0 * -f64::ln(rng.random_range(f64::MIN_POSITIVE..1.0))) as usize;
        let wrong = answer(300.0, chance, chance.saturating_sub(1), &mut rng);
        for (elsewhere, answer) in [(false, right), (true, wrong)] {
            all.push(Observation {
                scene,
                elsewhere,
                heading_known: true,
                real: false,
                answer: Some(answer),
            });
        }
    }
    all
}

fn check(calibration: &Calibration, observations: &[Observation]) -> Check {
    let mut check = Check::default();
    check.add(calibration, &observations.iter().collect::<Vec<_>>());
    check
}

#[test]
fn fitted_radii_hold_on_unseen_photos_and_halved_ones_do_not() {
    let calibration = fit(&observations(600, 1), "made up", ELSEWHERE_ANSWERED).unwrap();
    let unseen = observations(2000, 2);
    let found = check(&calibration, &unseen);
    let coverage = |c: &Check| c.covered as f64 / c.right as f64;
    assert!((0.93..=0.97).contains(&coverage(&found)), "{found:?}");
    // A radius scales with the square root of the covariance.
    let halved = Calibration {
        position: PositionError {
            inlier_factor: calibration.position.inlier_factor / 4.0,
            shared_px: calibration.position.shared_px / 2.0,
        },
        ..calibration.clone()
    };
    let halved = check(&halved, &unseen);
    assert!(coverage(&halved) < 0.7, "{halved:?}");
    let on = calibration.fitted_on.as_ref().unwrap();
    assert!((on.held_out_coverage_95 - 0.95).abs() < 0.03, "{on:?}");
    assert_eq!((on.photos, on.elsewhere), (600, 600));
}

#[test]
fn the_error_model_is_recovered() {
    let found = position::fit(&observations(4000, 3)).unwrap();
    let off = |found: f64, expected: f64| (found / expected).ln().abs();
    assert!(
        off(found.inlier_factor, TRUE_ERROR.inlier_factor) < 0.25,
        "{found:?}"
    );
    assert!(
        off(found.shared_px, TRUE_ERROR.shared_px) < 0.25,
        "{found:?}"
    );
}

#[test]
fn right_answers_are_given_and_those_from_elsewhere_are_not() {
    let calibration = fit(&observations(600, 4), "made up", ELSEWHERE_ANSWERED).unwrap();
    let found = check(&calibration, &observations(3000, 5));
    assert!(
        found.answered as f64 / found.here as f64 > 0.97,
        "{found:?}"
    );
    assert!(
        found.elsewhere_answered as f64 / found.elsewhere as f64 <= 2e-3,
        "{found:?}"
    );
}

#[test]
fn a_half_without_real_photos_taken_elsewhere_has_the_limit_of_all_that_it_has() {
    let half = observations(400, 9);
    let limit = |limiting| {
        let fitted = confidence::fit(&half, ELSEWHERE_ANSWERED, limiting).unwrap();
        fitted.needed
    };
    let by_all = limit(confidence::Limiting::All);
    assert_eq!(limit(confidence::Limiting::Real), by_all);
    assert_ne!(by_all, 0.5);
}

#[test]
fn too_little_is_refused_by_name() {
    let few = observations(30, 6);
    assert_eq!(
        position::fit(&few),
        Err(FitError::TooFewFixes {
            found: 30,
            needed: 40
        })
    );
    // Enough in all, and not of each half of the scenes.
    assert_eq!(
        fit(&observations(60, 10), "made up", ELSEWHERE_ANSWERED),
        Err(FitError::TooFewFixesOfHalf {
            found: 30,
            needed: 40
        })
    );
    let mut many = observations(100, 7);
    many.retain(|o| !o.elsewhere);
    let text = confidence::fit(&many, ELSEWHERE_ANSWERED, confidence::Limiting::All)
        .unwrap_err()
        .to_string();
    assert!(text.contains("only 0 photos taken elsewhere"), "{text}");
}

#[test]
fn observations_are_read_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("observations.csv");
    let mut all = observations(5, 8);
    all.push(Observation {
        scene: 3,
        elsewhere: true,
        heading_known: false,
        real: true,
        answer: None,
    });
    observation::write(std::fs::File::create(&path).unwrap(), &all).unwrap();
    assert_eq!(observation::read(&path).unwrap(), all);
    for one in all {
        let line = observation::line(&one).unwrap();
        assert_eq!(observation::of_line(&line), Some(one));
        assert_eq!(observation::of_line(&line[..line.len() / 2]), None);
    }
}
