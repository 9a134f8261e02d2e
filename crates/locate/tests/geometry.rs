//! Geometry and matching against OpenCV (golden/make_golden.py) and against properties that hold for any input.

#![allow(clippy::unwrap_used)]

use grimnet_kernels::Isa;
use grimnet_locate::internals::{
    correspondence::Correspondence,
    homography::{Homography, HomographyEstimator},
    matching::{Descriptors, Matcher},
    ransac::{Estimate, Estimator, Ransac, Score},
    refine::refine,
    sampler::{Progressive, Uniform},
    similarity::{Similarity, SimilarityEstimator},
    transform::Transform,
};
use nalgebra::{Matrix3, Point2};
use proptest::prelude::*;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
    matching: Matching,
}

#[derive(Deserialize)]
struct Case {
    kind: String,
    from: Vec<[f64; 2]>,
    to: Vec<[f64; 2]>,
    inliers: Vec<usize>,
    opencv_least_squares: Option<[[f64; 3]; 3]>,
    opencv_ransac: [[f64; 3]; 3],
    opencv_inliers: Vec<usize>,
}

#[derive(Deserialize)]
struct Matching {
    dim: usize,
    query: Vec<f32>,
    tile: Vec<f32>,
    mutual: Vec<(u32, u32)>,
    #[serde(rename = "mutual_ratio_0.8")]
    mutual_ratio: Vec<(u32, u32)>,
}

impl Case {
    fn pairs(&self) -> Vec<Correspondence> {
        self.from
            .iter()
            .zip(&self.to)
            .map(|(&a, &b)| Correspondence::new(Point2::from(a), Point2::from(b)))
            .collect()
    }
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("golden/geometry.json")).unwrap()
}

fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

fn choose(pairs: &[Correspondence], indices: &[usize]) -> Vec<Correspondence> {
    indices.iter().map(|&index| pairs[index]).collect()
}

/// Greatest distance on a 512 px picture between where two transforms send a point.
fn apart(a: &Homography, b: &Homography) -> f64 {
    let grid = (0..25).map(|i| Point2::new(f64::from(i % 5) * 128.0, f64::from(i / 5) * 128.0));
    grid.map(|point| (a.map(point).unwrap() - b.map(point).unwrap()).norm())
        .fold(0.0, f64::max)
}

const SEARCH: Ransac = Ransac {
    threshold_px: 4.0,
    max_iterations: 5000,
    confidence: 0.9999,
    score: Score::Truncated,
    local_optimisation: true,
    needs_support: true,
};

fn robust<const N: usize, E: Estimator>(
    estimator: &E,
    pairs: &[Correspondence],
    ransac: &Ransac,
) -> (Estimate<E::Model>, E::Model)
where
    E::Model: Transform<N>,
{
    let estimate = ransac.run(estimator, pairs, &mut Uniform::new(7)).unwrap();
    let refined = refine(&estimate.model, &choose(pairs, &estimate.inliers)).unwrap();
    (estimate, refined.model)
}

#[test]
fn least_squares_homography_is_opencvs() {
    for case in golden()
        .cases
        .iter()
        .filter(|case| case.kind == "homography")
    {
        let pairs = choose(&case.pairs(), &case.inliers);
        let start = Homography::fit(&pairs).unwrap();
        let refined = refine(&start, &pairs).unwrap();
        let expected =
            Homography::from_matrix(matrix(case.opencv_least_squares.as_ref().unwrap())).unwrap();
        let cost = |model: &Homography| {
            pairs
                .iter()
                .map(|pair| model.squared_error(pair.from, pair.to))
                .sum::<f64>()
        };
        assert!(
            refined.weighted_squares_px2 <= cost(&expected) * (1.0 + 1e-9),
            "{} > {}",
            refined.weighted_squares_px2,
            cost(&expected)
        );
        assert!((refined.weighted_squares_px2 - cost(&refined.model)).abs() < 1e-6);
        // OpenCV stops its Levenberg-Marquardt after ten steps.
        assert!(
            apart(&refined.model, &expected) < 2e-3,
            "{}",
            apart(&refined.model, &expected)
        );
        // The linear solution alone is near it.
        assert!(apart(&start, &expected) < 0.5);
    }
}

#[test]
fn robust_models_and_inliers_are_opencvs() {
    for case in golden().cases {
        let pairs = case.pairs();
        let expected = Homography::from_matrix(matrix(&case.opencv_ransac)).unwrap();
        for ransac in [
            SEARCH,
            Ransac {
                max_iterations: 5000,
                ..Ransac::PAPER
            },
        ] {
            let (inliers, model) = match case.kind.as_str() {
                "homography" => {
                    let (estimate, model) =
                        robust::<8, _>(&HomographyEstimator::default(), &pairs, &ransac);
                    (estimate.inliers, model)
                }
                _ => {
                    let (estimate, model) =
                        robust::<4, _>(&SimilarityEstimator::default(), &pairs, &ransac);
                    (estimate.inliers, Homography::of(&model).unwrap())
                }
            };
            // Pairs near the threshold may fall on either side, for OpenCV judges them before its last fit.
            let strangers = inliers
                .iter()
                .filter(|index| !case.opencv_inliers.contains(index))
                .count();
            let missed = case
                .opencv_inliers
                .iter()
                .filter(|index| !inliers.contains(index))
                .count();
            // Without local optimisation the first sample of inliers ends the search, however noisy.
            let (allowed, limit) = match ransac.local_optimisation {
                true => (1, if strangers + missed == 0 { 0.01 } else { 2.0 }),
                false => (case.opencv_inliers.len() / 6, 2.0),
            };
            assert!(
                strangers + missed <= allowed,
                "{strangers} strangers, {missed} missed"
            );
            assert!(
                apart(&model, &expected) < limit,
                "{} {}",
                case.kind,
                apart(&model, &expected)
            );
        }
    }
}

#[test]
fn matches_are_opencvs() {
    let golden = golden().matching;
    let mut matcher = Matcher::new(Isa::detect());
    let mut matches = Vec::new();
    let (query, tile) = (
        Descriptors::F32(&golden.query),
        Descriptors::F32(&golden.tile),
    );
    for (ratio, expected) in [(None, &golden.mutual), (Some(0.8), &golden.mutual_ratio)] {
        matcher
            .mutual(query, tile, golden.dim, ratio, &mut matches)
            .unwrap();
        let found: Vec<(u32, u32)> = matches
            .iter()
            .map(|found| (found.query, found.tile))
            .collect();
        assert_eq!(&found, expected);
    }
}

#[test]
fn quantised_matches_are_nearly_the_same() {
    let golden = golden().matching;
    let step = 1.0 / 127.0;
    let quantise = |rows: &[f32]| {
        rows.iter()
            .map(|value| (value / step).round() as i8)
            .collect::<Vec<_>>()
    };
    let (query, tile) = (quantise(&golden.query), quantise(&golden.tile));
    let mut matches = Vec::new();
    let side = |values| Descriptors::I8 {
        values,
        scale: step,
    };
    Matcher::new(Isa::detect())
        .mutual(
            side(&query),
            side(&tile),
            golden.dim,
            Some(0.8),
            &mut matches,
        )
        .unwrap();
    let kept = matches
        .iter()
        .filter(|found| golden.mutual_ratio.contains(&(found.query, found.tile)))
        .count();
    assert!(kept * 20 >= golden.mutual_ratio.len() * 19, "{kept}");
    for found in &matches {
        let (a, b) = (
            found.query as usize * golden.dim,
            found.tile as usize * golden.dim,
        );
        let exact: f32 = golden.query[a..][..golden.dim]
            .iter()
            .zip(&golden.tile[b..][..golden.dim])
            .map(|(x, y)| x * y)
            .sum();
        assert!((exact - found.similarity).abs() < 0.02);
    }
}

#[test]
fn guided_matches_are_mutual_among_the_allowed_pairs_and_nearly_the_best_of_all() {
    let golden = golden().matching;
    let dim = golden.dim;
    let (n, m) = (golden.query.len() / dim, golden.tile.len() / dim);
    let similarity = |i: usize, j: usize| -> f32 {
        let (a, b) = (
            &golden.query[i * dim..][..dim],
            &golden.tile[j * dim..][..dim],
        );
        a.iter().zip(b).map(|(x, y)| x * y).sum()
    };
    let is_near = |i: usize, j: usize| (i * 7 + j * 5) % 11 < 2;
    let closer = |i: usize, j: usize| {
        let all = (0..m).map(|other| similarity(i, other));
        all.filter(|&other| other > similarity(i, j) + 1e-6).count()
    };
    for max_closer in [0, 1, 5, usize::MAX] {
        let mut expected = Vec::new();
        for i in 0..n {
            let best = (0..m)
                .filter(|&j| is_near(i, j))
                .max_by(|&a, &b| similarity(i, a).total_cmp(&similarity(i, b)));
            let Some(j) = best else { continue };
            let rival = (0..n)
                .filter(|&other| is_near(other, j))
                .max_by(|&a, &b| similarity(a, j).total_cmp(&similarity(b, j)));
            if rival == Some(i) && closer(i, j) <= max_closer {
                expected.push((i as u32, j as u32));
            }
        }
        let mut matcher = Matcher::new(Isa::detect());
        let mut compared = matcher
            .compare(
                Descriptors::F32(&golden.query),
                Descriptors::F32(&golden.tile),
                dim,
            )
            .unwrap();
        let mut matches = Vec::new();
        compared.guided(
            |i, near| near.extend((0..m).filter(|&j| is_near(i, j))),
            max_closer,
            &mut matches,
        );
        let found: Vec<(u32, u32)> = matches.iter().map(|m| (m.query, m.tile)).collect();
        assert!(max_closer == 0 || !expected.is_empty());
        assert_eq!(found, expected, "at most {max_closer} closer");
    }
}

#[test]
fn matching_refuses_what_it_cannot_compare() {
    let mut matcher = Matcher::new(Isa::detect());
    let mut matches = Vec::new();
    let floats = [0.0; 32];
    let bytes = Descriptors::I8 {
        values: &[0; 32],
        scale: 1.0,
    };
    assert!(
        matcher
            .mutual(Descriptors::F32(&floats), bytes, 16, None, &mut matches)
            .is_err()
    );
    assert!(
        matcher
            .mutual(
                Descriptors::F32(&floats),
                Descriptors::F32(&floats),
                15,
                None,
                &mut matches
            )
            .is_err()
    );
    assert!(
        matcher
            .mutual(
                Descriptors::F32(&floats),
                Descriptors::F32(&floats),
                0,
                None,
                &mut matches
            )
            .is_err()
    );
    assert!(
        matcher
            .mutual(
                Descriptors::F32(&[]),
                Descriptors::F32(&floats),
                16,
                None,
                &mut matches
            )
            .is_ok()
    );
    assert!(matches.is_empty());
    // Equal rows: the first of each wins, none is used twice.
    matcher
        .mutual(
            Descriptors::F32(&floats),
            Descriptors::F32(&floats),
            16,
            None,
            &mut matches,
        )
        .unwrap();
    assert_eq!(
        matches
            .iter()
            .map(|found| (found.query, found.tile))
            .collect::<Vec<_>>(),
        [(0, 0)]
    );
}

#[test]
fn degenerate_points_give_no_model() {
    let pair = |a: [f64; 2], b: [f64; 2]| Correspondence::new(Point2::from(a), Point2::from(b));
    let line: Vec<_> = (0..40)
        .map(|i| f64::from(i) * 10.0)
        .map(|t| pair([t, 2.0 * t], [t + 5.0, 2.0 * t - 7.0]))
        .collect();
    let repeated: Vec<_> = (0..40)
        .map(|_| pair([100.0, 100.0], [50.0, 60.0]))
        .collect();
    let two_spots: Vec<_> = (0..40)
        .map(|i| {
            if i % 2 == 0 {
                pair([100.0, 100.0], [50.0, 60.0])
            } else {
                pair([300.0, 100.0], [250.0, 60.0])
            }
        })
        .collect();
    let mirrored: Vec<_> = (0..40)
        .map(|i| [f64::from(i * 37 % 41) * 10.0, f64::from(i * 17 % 29) * 14.0])
        .map(|[x, y]| pair([x, y], [500.0 - x, y]))
        .collect();
    let not_finite: Vec<_> = (0..40)
        .map(|i| pair([f64::NAN, f64::from(i)], [f64::INFINITY, 1.0]))
        .collect();
    let homography = |pairs: &[Correspondence]| {
        SEARCH.run(&HomographyEstimator::default(), pairs, &mut Uniform::new(1))
    };
    let similarity = |pairs: &[Correspondence]| {
        SEARCH.run(
            &SimilarityEstimator::default(),
            pairs,
            &mut Progressive::new(1),
        )
    };
    for pairs in [&line, &repeated, &two_spots, &mirrored, &not_finite] {
        assert_eq!(homography(pairs), None);
        assert_eq!(Homography::fit(pairs), None);
    }
    assert_eq!(homography(&line[..3]), None);
    assert_eq!(homography(&[]), None);
    assert_eq!(similarity(&repeated), None);
    assert_eq!(similarity(&not_finite), None);
    assert_eq!(similarity(&line[..1]), None);
    assert!(
        refine(
            &Similarity {
                a: 1.0,
                b: 0.0,
                tx: 0.0,
                ty: 0.0
            },
            &repeated
        )
        .is_none()
    );
}

fn transform() -> impl Strategy<Value = Homography> {
    (
        0.5..2.0f64,
        -3.1..3.1f64,
        -500.0..500.0f64,
        -500.0..500.0f64,
        -2e-4..2e-4f64,
        -2e-4..2e-4f64,
    )
        .prop_map(|(s, r, x, y, p, q)| {
            let (sin, cos) = r.sin_cos();
            Homography::from_matrix(Matrix3::new(
                s * cos,
                -s * sin,
                x,
                s * sin,
                s * cos,
                y,
                p,
                q,
                1.0,
            ))
            .unwrap()
        })
}

fn scattered(count: usize) -> impl Strategy<Value = Vec<Point2<f64>>> {
    prop::collection::vec(
        (0.0..512.0f64, 0.0..512.0f64).prop_map(|(x, y)| Point2::new(x, y)),
        count,
    )
}

proptest! {
    #[test]
    fn exact_points_give_the_exact_homography(truth in transform(), points in scattered(24)) {
        let pairs: Vec<_> = points.iter().map(|&p| Correspondence::new(p, truth.map(p).unwrap())).collect();
        let found = Homography::fit(&pairs).unwrap();
        prop_assert!(apart(&found, &truth) < 1e-5);
        let back = found.inverse().unwrap();
        for pair in &pairs {
            prop_assert!((back.map(pair.to).unwrap() - pair.from).norm() < 1e-4);
        }
    }

    #[test]
    fn jacobians_are_the_differences(truth in transform(), p in scattered(1)) {
        let (step, p) = (1e-4, p[0]);
        let at = truth.map(p).unwrap();
        let by_point = truth.point_jacobian(p).unwrap();
        let moved = truth.map(Point2::new(p.x + step, p.y)).unwrap();
        prop_assert!(((moved - at) / step - by_point.column(0)).norm() < 1e-3);
        let by_parameters = truth.parameter_jacobian(p).unwrap();
        for i in 0..8 {
            let mut parameters = truth.parameters();
            let step = if i > 5 { 1e-9 } else { 1e-5 };
            parameters[i] += step;
            let moved = truth.with_parameters(&parameters).map(p).unwrap();
            let column = by_parameters.column(i);
            prop_assert!(((moved - at) / step - column).norm() < 1e-3 * (1.0 + column.norm()));
        }
    }

    #[test]
    fn outliers_do_not_move_the_answer(truth in transform(), points in scattered(80), wrong in scattered(80), seed in 0u64..9) {
        let pairs: Vec<_> = points.iter().zip(&wrong).enumerate()
            .map(|(i, (&p, &w))| Correspondence::new(p, if i % 2 == 0 { truth.map(p).unwrap() } else { w + nalgebra::Vector2::new(2000.0, 0.0) }))
            .collect();
        let found = SEARCH.run(&HomographyEstimator::default(), &pairs, &mut Uniform::new(seed)).unwrap();
        prop_assert!(apart(&found.model, &truth) < 1e-4);
        prop_assert_eq!(found.inliers.len(), 40);
        let again = SEARCH.run(&HomographyEstimator::default(), &pairs, &mut Uniform::new(seed)).unwrap();
        prop_assert_eq!(again, found);
    }

    #[test]
    fn any_numbers_are_survived(numbers in prop::collection::vec(prop::num::f64::ANY, 0..64)) {
        let pairs: Vec<_> = numbers.chunks_exact(4)
            .map(|n| Correspondence::new(Point2::new(n[0], n[1]), Point2::new(n[2], n[3]))).collect();
        let _ = SEARCH.run(&HomographyEstimator::default(), &pairs, &mut Progressive::new(3));
        let _ = SEARCH.run(&SimilarityEstimator::default(), &pairs, &mut Uniform::new(3));
        if let Some(fit) = Homography::fit(&pairs) {
            let _ = refine(&fit, &pairs);
        }
    }

    #[test]
    fn similarity_refinement_is_its_closed_form(points in scattered(12), noise in scattered(12), weights in prop::collection::vec(0.01..1.0f64, 12)) {
        let truth = Similarity { a: 0.8, b: -0.5, tx: 40.0, ty: -90.0 };
        let pairs: Vec<_> = points.iter().zip(&noise).zip(&weights)
            .map(|((&p, n), &w)| Correspondence::weighted(p, truth.map(p).unwrap() + n.coords * 0.01, w)).collect();
        let (fit, refined) = (Similarity::fit(&pairs).unwrap(), refine(&truth, &pairs).unwrap().model);
        prop_assert!((fit.parameters() - refined.parameters()).norm() < 1e-6);
    }
}
