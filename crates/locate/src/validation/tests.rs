use grimnet_geo::LonLat;

use super::*;

const NAN: f64 = f64::NAN;
const INFINITY: f64 = f64::INFINITY;

/// The field that the error names; `None` without an error.
fn refused(result: Result<()>) -> Option<&'static str> {
    match result {
        Ok(()) => None,
        Err(LocateError::InvalidValue {
            field, expected, ..
        }) => {
            assert!(!expected.is_empty());
            Some(field)
        }
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn both_named_sets_are_valid() {
    assert_eq!(refused(Options::default().check()), None);
    assert_eq!(refused(Options::paper().check()), None);
}

fn changed(change: impl Fn(&mut Options)) -> Options {
    let mut options = Options::default();
    change(&mut options);
    options
}

fn changed_gates(change: impl Fn(&mut Gates)) -> Options {
    changed(|options| change(options.gates.as_mut().unwrap()))
}

fn changed_map_vote(change: impl Fn(&mut MapVoteOptions)) -> Options {
    changed(|options| change(options.map_vote.as_mut().unwrap()))
}

fn changed_vote(change: impl Fn(&mut VoteOptions)) -> Options {
    changed(|options| change(options.vote.as_mut().unwrap()))
}

#[test]
fn every_setting_out_of_range_is_named() {
    let without_probes = Index::IvfPq {
        nlist: 256,
        subquantisers: 64,
        nprobe: 0,
        rerank_factor: 0,
    };
    for (field, options) in [
        ("top_k", changed(|o| o.top_k = 0)),
        ("index.nprobe", changed(|o| o.index = Some(without_probes))),
        (
            "keypoint_threshold",
            changed(|o| o.keypoint_threshold = f32::NAN),
        ),
        (
            "keypoint_threshold",
            changed(|o| o.keypoint_threshold = -0.1),
        ),
        (
            "keypoint_threshold",
            changed(|o| o.keypoint_threshold = 1.1),
        ),
        ("max_keypoints", changed(|o| o.max_keypoints = 0)),
        ("stages", changed(|o| o.stages = vec![64, 0])),
        ("max_matched", changed(|o| o.max_matched = 0)),
        ("first_matched", changed(|o| o.first_matched = 0)),
        ("joint_candidates", changed(|o| o.joint_candidates = 0)),
        ("joint_matched", changed(|o| o.joint_matched = 0)),
        ("max_ratio", changed(|o| o.max_ratio = Some(f32::NAN))),
        ("max_ratio", changed(|o| o.max_ratio = Some(0.0))),
        ("headings", changed(|o| o.headings = 0)),
        ("headings", changed(|o| o.headings = 361)),
        ("unknown_scales", changed(|o| o.unknown_scales.clear())),
        ("unknown_scales", changed(|o| o.unknown_scales[0] = 0.0)),
        ("query_side_px", changed(|o| o.query_side_px = 31)),
        ("hypothesis_side_px", changed(|o| o.hypothesis_side_px = 5)),
        ("query_width_px", changed(|o| o.query_width_px = 31.9)),
        ("budget_ms", changed(|o| o.budget_ms = Some(0.0))),
        ("vote.keypoints", changed_vote(|v| v.keypoints = 0)),
        ("vote.bin_px", changed_vote(|v| v.bin_px = 0.5)),
        (
            "map_vote.keypoints",
            changed_map_vote(|v| v.keypoints = 1 << 16),
        ),
        ("map_vote.lists", changed_map_vote(|v| v.lists = 0)),
        (
            "map_vote.candidates",
            changed_map_vote(|v| v.candidates = 0),
        ),
        ("map_vote.bin_px", changed_map_vote(|v| v.bin_px = 0.0)),
        (
            "map_vote.similarity_votes",
            changed_map_vote(|v| v.similarity_votes = 0.0),
        ),
        (
            "vote.recount",
            changed_vote(|v| v.recount.as_mut().unwrap().keypoints = 0),
        ),
        ("finalists", changed(|o| o.finalists = 0)),
        (
            "ransac.threshold_px",
            changed(|o| o.ransac.threshold_px = 0.0),
        ),
        (
            "ransac.max_iterations",
            changed(|o| o.ransac.max_iterations = 0),
        ),
        ("ransac.confidence", changed(|o| o.ransac.confidence = 0.0)),
        ("ransac.confidence", changed(|o| o.ransac.confidence = 1.5)),
        (
            "gates.min_inlier_share",
            changed_gates(|g| g.min_inlier_share = 1.5),
        ),
        (
            "gates.min_confidence",
            changed_gates(|g| g.min_confidence = Some(-0.1)),
        ),
    ] {
        assert_eq!(refused(options.check()), Some(field), "{options:?}");
    }
}

#[test]
fn every_setting_that_is_not_finite_or_negative_is_named() {
    for bad in [NAN, INFINITY, -1.0] {
        for (field, options) in [
            ("query_width_px", changed(|o| o.query_width_px = bad)),
            ("budget_ms", changed(|o| o.budget_ms = Some(bad))),
            ("map_error_m", changed(|o| o.map_error_m = bad)),
            ("unknown_scales", changed(|o| o.unknown_scales.push(bad))),
            ("vote.bin_px", changed_vote(|v| v.bin_px = bad)),
            (
                "vote.similarity_votes",
                changed_vote(|v| v.similarity_votes = bad),
            ),
            (
                "ransac.threshold_px",
                changed(|o| o.ransac.threshold_px = bad),
            ),
            ("ransac.confidence", changed(|o| o.ransac.confidence = bad)),
            (
                "gates.max_scale_change",
                changed_gates(|g| g.max_scale_change = bad),
            ),
            ("gates.max_shear", changed_gates(|g| g.max_shear = bad)),
            (
                "gates.max_perspective_per_px",
                changed_gates(|g| g.max_perspective_per_px = bad),
            ),
            ("gates.min_spread", changed_gates(|g| g.min_spread = bad)),
            ("gates.min_margin", changed_gates(|g| g.min_margin = bad)),
            (
                "gates.min_inlier_share",
                changed_gates(|g| g.min_inlier_share = bad),
            ),
            (
                "gates.min_confidence",
                changed_gates(|g| g.min_confidence = Some(bad)),
            ),
        ] {
            assert_eq!(refused(options.check()), Some(field), "{options:?}");
        }
    }
}

#[test]
fn every_invalid_prior_value_is_named() {
    let none = Prior::none;
    let somewhere = LonLat::new(120.7, 24.2);
    let valid = none()
        .with_heading(-90.0, 0.0)
        .with_pitch_deg(-60.0)
        .with_height_agl_m(120.0)
        .with_hfov_deg(70.0)
        .with_gsd_m(0.05)
        .near(somewhere, 500.0);
    assert_eq!(refused(valid.check()), None);
    assert_eq!(refused(none().check()), None);
    let mut cases = vec![
        ("heading sigma_deg", none().with_heading(10.0, -1.0)),
        ("pitch_deg", none().with_pitch_deg(30.0)),
        ("height_agl_m", none().with_height_agl_m(0.0)),
        ("hfov_deg", none().with_hfov_deg(0.0)),
        ("hfov_deg", none().with_hfov_deg(180.0)),
        ("gsd_m", none().with_gsd_m(0.0)),
        ("near.radius_m", none().near(somewhere, 0.0)),
        ("near.centre", none().near(LonLat::new(0.0, 91.0), 100.0)),
    ];
    for bad in [NAN, INFINITY, -INFINITY] {
        cases.extend([
            ("heading_deg", none().with_heading(bad, 5.0)),
            ("heading sigma_deg", none().with_heading(5.0, bad)),
            ("pitch_deg", none().with_pitch_deg(bad)),
            ("height_agl_m", none().with_height_agl_m(bad)),
            ("hfov_deg", none().with_hfov_deg(bad)),
            ("gsd_m", none().with_gsd_m(bad)),
            ("near.centre", none().near(LonLat::new(bad, 0.0), 100.0)),
            ("near.centre", none().near(LonLat::new(0.0, bad), 100.0)),
            ("near.radius_m", none().near(somewhere, bad)),
        ]);
    }
    for (field, prior) in cases {
        assert_eq!(refused(prior.check()), Some(field), "{prior:?}");
    }
}

#[test]
fn the_error_says_field_value_and_what_is_expected() {
    let options = Options {
        map_error_m: -2.5,
        ..Options::default()
    };
    assert_eq!(
        options.check().unwrap_err().to_string(),
        "map_error_m is -2.5; expected 0 to 100000 metres"
    );
}
