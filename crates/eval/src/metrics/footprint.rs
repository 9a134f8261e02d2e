//! Figures relative to the ground width of the photos, for data sets whose metres are nominal or whose photos differ in scale.
//!
//! A fix is right within [`RIGHT_SHARE`] of the photo's ground width. It is wrong beyond that plus [`TRUTH_SIGMAS`] times the
//! error of the truth; a fix in between is neither, since the truth does not tell.

use serde::Serialize;

use super::frame::Frame;
use super::places::{by_place, places};
use super::statistics::{grouped_share_interval, percentile};

/// Largest error of a right fix, as a share of the ground width of the photo.
pub const RIGHT_SHARE: f64 = 0.05;

/// Standard deviations of the truth that are added before a fix counts as wrong.
pub const TRUTH_SIGMAS: f64 = 3.0;

/// Largest error of a right fix if the ground width is not known, metres (the paper's success radius).
pub const RIGHT_WITHIN_M: f64 = 20.0;

/// Returns whether a photo has a right fix: within [`RIGHT_SHARE`] of its ground width, or within [`RIGHT_WITHIN_M`] if that is
/// not known.
#[must_use]
pub fn is_right(frame: &Frame) -> bool {
    frame
        .error_m
        .is_some_and(|error_m| error_m <= right_within_m(frame))
}

/// 1 for a photo with a right fix, else 0.
pub(super) fn outcome(frame: &Frame) -> f64 {
    f64::from(u8::from(is_right(frame)))
}

/// Returns whether a photo has a wrong fix: an error that the error of the truth does not explain.
#[must_use]
pub fn is_wrong(frame: &Frame) -> bool {
    let truth_m = TRUTH_SIGMAS * frame.truth_error_m.unwrap_or(0.0);
    frame
        .error_m
        .is_some_and(|error_m| error_m > right_within_m(frame) + truth_m)
}

fn right_within_m(frame: &Frame) -> f64 {
    frame
        .footprint_width_m
        .map_or(RIGHT_WITHIN_M, |width_m| RIGHT_SHARE * width_m)
}

/// Figures relative to the ground width of the photos.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FootprintSummary {
    /// Photos whose ground width is known.
    pub photos: usize,
    /// Those with enough features to be localised, or of which that is not known.
    pub answerable: usize,
    /// Answerable photos with a fix.
    pub answerable_fixes: usize,
    /// Answerable photos with a right fix.
    pub right: usize,
    /// `right` as a share of `answerable`.
    pub right_share: f64,
    /// 95 % interval of `right_share`: what resampling whole places (bootstrap) and Wilson's on their number span together.
    pub right_share_interval: [f64; 2],
    /// Places: by name, or photos without one by the ground that they show. A photo belongs to the first place whose first photo
    /// is nearer than the narrower of their two ground widths.
    pub places: usize,
    /// Photos with a wrong fix, of all photos: answerable or not, by metres where the ground width is not known ([`is_wrong`]).
    pub wrong: usize,
    /// Photos with a fix that is neither right nor wrong, of all photos.
    pub undecided: usize,
    /// Median error as a share of the ground width over the answerable photos, a miss counting as infinite; `None` if half of
    /// them or more are missed.
    pub median_share: Option<f64>,
    /// 90th percentile of the error of the fixes as a share of the ground width.
    pub fixes_p90_share: Option<f64>,
}

impl FootprintSummary {
    /// Figures of the photos whose ground width is known, and the wrong fixes of all; `None` if no ground width is known.
    #[must_use]
    pub fn of(frames: &[Frame]) -> Option<Self> {
        let all: Vec<&Frame> = frames.iter().collect();
        let known: Vec<&Frame> = all
            .iter()
            .copied()
            .filter(|frame| frame.footprint_width_m.is_some())
            .collect();
        if known.is_empty() {
            return None;
        }
        let answerable: Vec<&Frame> = known
            .iter()
            .copied()
            .filter(|frame| frame.answerable != Some(false))
            .collect();
        let count = |of: &[&Frame], wanted: fn(&Frame) -> bool| {
            of.iter().filter(|frame| wanted(frame)).count()
        };
        let right = count(&answerable, is_right);
        let right_by_place = by_place(&places(&answerable), |frame| Some(outcome(frame)));
        let shares: Vec<f64> = answerable
            .iter()
            .map(|frame| frame.footprint_share().unwrap_or(f64::INFINITY))
            .collect();
        let fixed: Vec<f64> = known.iter().filter_map(|f| f.footprint_share()).collect();
        Some(Self {
            photos: known.len(),
            answerable: answerable.len(),
            answerable_fixes: count(&answerable, |frame| frame.fixed),
            right,
            right_share: right as f64 / answerable.len().max(1) as f64,
            right_share_interval: grouped_share_interval(&right_by_place),
            places: right_by_place.len(),
            wrong: count(&all, is_wrong),
            undecided: count(&all, |f| f.fixed && !is_right(f) && !is_wrong(f)),
            median_share: percentile(&shares, 0.5),
            fixes_p90_share: percentile(&fixed, 0.9),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::statistics::wilson_interval;
    use super::*;
    use grimnet_geo::{LonLat, destination_en_m};

    fn frame(place: &str, error_m: Option<f64>, answerable: bool) -> Frame {
        Frame {
            fixed: error_m.is_some(),
            error_m,
            footprint_width_m: Some(200.0),
            truth_error_m: Some(2.0),
            place: Some(place.to_owned()),
            answerable: Some(answerable),
            ..Frame::default()
        }
    }

    #[test]
    fn figures_of_a_case_done_by_hand() {
        // 200 m wide: right within 10 m, wrong beyond 16 m.
        let frames = [
            frame("a", Some(10.0), true),
            frame("a", Some(15.0), true),
            frame("b", Some(16.5), true),
            frame("b", None, true),
            frame("c", Some(100.0), false),
            Frame::default(),
        ];
        let summary = FootprintSummary::of(&frames).unwrap();
        assert_eq!(
            (summary.photos, summary.answerable, summary.places),
            (5, 4, 2)
        );
        assert_eq!((summary.right, summary.wrong, summary.undecided), (1, 2, 1));
        assert_eq!(summary.answerable_fixes, 3);
        assert!((summary.right_share - 0.25).abs() < 1e-12);
        assert!((summary.median_share.unwrap() - 0.07875).abs() < 1e-12);
        // Either place may be drawn twice, and two places say little.
        let [low, high] = summary.right_share_interval;
        assert_eq!((low, high), (0.0, wilson_interval(0.25, 2)[1]));
        assert_eq!(FootprintSummary::of(&[Frame::default()]), None);
    }

    #[test]
    fn a_wrong_fix_counts_where_other_photos_alone_have_a_ground_width() {
        let by_metres = |error_m| Frame {
            footprint_width_m: None,
            ..frame("b", Some(error_m), true)
        };
        // Without a width right within 20 m, wrong beyond 26 m.
        let frames = [
            frame("a", Some(1.0), true),
            by_metres(1.0),
            by_metres(21.0),
            by_metres(110.0),
        ];
        let summary = FootprintSummary::of(&frames).unwrap();
        assert_eq!((summary.photos, summary.right), (1, 1));
        assert_eq!((summary.wrong, summary.undecided), (1, 1));
    }

    #[test]
    fn photos_of_one_flight_are_as_few_places_as_their_ground_and_no_certainty() {
        // Thirty photos 21 m apart, 200 m wide: every tenth is a new place.
        let flight: Vec<Frame> = (0..30)
            .map(|i| Frame {
                place: None,
                truth: Some(destination_en_m(
                    LonLat::new(120.7, 24.2),
                    21.0 * f64::from(i),
                    0.0,
                )),
                shown_width_m: Some(200.0),
                ..frame("", Some(1.0), true)
            })
            .collect();
        let summary = FootprintSummary::of(&flight).unwrap();
        assert_eq!((summary.right, summary.places), (30, 3));
        assert_eq!(summary.right_share_interval, wilson_interval(1.0, 3));
        assert!(summary.right_share_interval[0] < 0.5, "{summary:?}");
    }

    #[test]
    fn metres_decide_where_no_ground_width_is_known() {
        let error = |error_m| Frame {
            error_m: Some(error_m),
            ..Frame::default()
        };
        assert!(is_right(&error(20.0)) && !is_wrong(&error(20.0)));
        assert!(!is_right(&error(20.1)) && is_wrong(&error(20.1)));
        assert!(!is_right(&Frame::default()) && !is_wrong(&Frame::default()));
    }
}
