//! Homographies against OpenCV and under random transforms.

use super::*;

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

/// The scale of the similarity found where 36 points lie on a roof, at 0.8 of the ground's scale of 1, and `on_ground` on the ground.
fn scale_beside_a_roof(on_ground: usize, scale_prior: Option<ScalePrior>) -> f64 {
    let plane = |scale: f64, shift: f64| Similarity {
        a: scale,
        b: 0.0,
        tx: shift,
        ty: shift,
    };
    let point = |i: usize| Point2::new((37 * i % 320) as f64, (91 * i % 240) as f64);
    let on = |plane: Similarity, i| Correspondence::new(point(i), plane.map(point(i)).unwrap());
    let pairs: Vec<Correspondence> = (0..36)
        .map(|i| on(plane(0.8, 90.0), i))
        .chain((36..36 + on_ground).map(|i| on(plane(1.0, 0.0), i)))
        .collect();
    let estimator = SimilarityEstimator {
        scale_prior,
        ..SimilarityEstimator::default()
    };
    let found = SEARCH.run(&estimator, &pairs, &mut Uniform::new(7));
    found.unwrap().model.scale()
}

#[test]
fn of_two_planes_the_one_at_the_stated_scale_is_found_unless_it_has_far_fewer_points() {
    let stated = Some(ScalePrior {
        scale: 1.0,
        relative_sigma: 0.15,
    });
    assert!((scale_beside_a_roof(30, None) - 0.8).abs() < 1e-9);
    assert!((scale_beside_a_roof(30, stated) - 1.0).abs() < 1e-9);
    assert!((scale_beside_a_roof(15, stated) - 0.8).abs() < 1e-9);
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
