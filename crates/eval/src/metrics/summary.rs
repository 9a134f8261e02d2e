//! Figures over all photos of a run.

use std::collections::BTreeMap;

use serde::Serialize;

use super::frame::Frame;
use super::places::{by_place, places};
use super::risk_coverage;
use super::statistics::{
    grouped_bootstrap_interval, grouped_share_interval, mean, percentile, share_within,
};

/// An error above this many metres is "confidently wrong" whatever uncertainty was stated.
pub const CONFIDENTLY_WRONG_M: f64 = 100.0;

/// An error beyond this many standard deviations of the stated covariance is "confidently wrong" if it exceeds 20 m.
pub const CONFIDENTLY_WRONG_SIGMA: f64 = 3.0;

/// Figures over all photos of a run. In every share of all frames, a photo without a fix counts as a miss.
///
/// Intervals are of 95 % and by place, for photos of one place are not independent: whole places are resampled (bootstrap); that of a
/// share spans Wilson's on their number, too.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Photos scored.
    pub frames: usize,
    /// Frames with a fix.
    pub fixes: usize,
    /// Share of all frames within 5 m.
    pub within_5m: f64,
    /// Share of all frames within 10 m.
    pub within_10m: f64,
    /// Share of all frames within 20 m (the paper's success rate).
    pub within_20m: f64,
    /// Share of all frames within 25 m.
    pub within_25m: f64,
    /// Interval of `within_5m`.
    pub within_5m_interval: [f64; 2],
    /// Median error over all photos, a miss counting as infinite; `None` if half of the photos or more are missed.
    pub median_m: Option<f64>,
    /// 90th percentile of the error over all photos, counted likewise.
    pub p90_m: Option<f64>,
    /// Average localisation error over the fixes (the paper's ALE).
    pub ale_m: Option<f64>,
    /// Mean error eastwards over the fixes.
    pub bias_east_m: Option<f64>,
    /// Mean error northwards over the fixes.
    pub bias_north_m: Option<f64>,
    /// Fixes with an error above 3 stated standard deviations and 20 m, or above 100 m.
    pub confidently_wrong: usize,
    /// Fixes with an error above 3 stated standard deviations; 1.1 % are expected if the covariance is right.
    pub beyond_3_sigma: usize,
    /// Share of all frames with a fix.
    pub availability: f64,
    /// Share of fixes within 20 m.
    pub precision: Option<f64>,
    /// Share of fixes whose error lies within the stated 50 % radius.
    pub coverage_50: Option<f64>,
    /// Share of fixes whose error lies within the stated 90 % radius.
    pub coverage_90: Option<f64>,
    /// Share of fixes whose error lies within the stated 95 % radius.
    pub coverage_95: Option<f64>,
    /// Interval of `coverage_95`.
    pub coverage_95_interval: Option<[f64; 2]>,
    /// Share of fixes within the 95 % radius enlarged by the error of the truth; `None` if that is not known.
    pub coverage_95_with_truth_error: Option<f64>,
    /// Median of the stated 95 % radius.
    pub radius95_median_m: Option<f64>,
    /// Area under the curve of risk against coverage; 0 is best.
    pub risk_coverage_area: Option<f64>,
    /// Interval of `median_m`; `None` if it reaches into the misses, or for a single place.
    pub median_interval_m: Option<[f64; 2]>,
    /// Interval of `ale_m`; `None` if the fixes are of a single place.
    pub ale_interval_m: Option<[f64; 2]>,
    /// Median distance of the fixes from the satellite receiver, if its position is known.
    pub gps_median_m: Option<f64>,
    /// Average distance of the fixes from the satellite receiver.
    pub gps_ale_m: Option<f64>,
    /// Share of the frames whose receiver's position is known within 20 m of it.
    pub gps_within_20m: Option<f64>,
    /// Median and 95th percentile of the time by stage, milliseconds.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub stage_p50_p95_ms: BTreeMap<String, [f64; 2]>,
    /// Median time per photo, milliseconds.
    pub time_p50_ms: Option<f64>,
    /// 95th percentile of the time per photo, milliseconds.
    pub time_p95_ms: Option<f64>,
}

impl Summary {
    /// Figures of these photos.
    #[must_use]
    pub fn of(frames: &[Frame]) -> Self {
        let error_of = |f: &Frame| f.error_m.unwrap_or(f64::INFINITY);
        let errors: Vec<f64> = frames.iter().map(error_of).collect();
        let fixes: Vec<&Frame> = frames.iter().filter(|f| f.error_m.is_some()).collect();
        let values = |value: &dyn Fn(&Frame) -> Option<f64>| -> Vec<f64> {
            fixes.iter().filter_map(|f| value(f)).collect()
        };
        let mean_of = |value: &dyn Fn(&Frame) -> Option<f64>| mean(&values(value));
        let is_inside = |f: &Frame, radius_m: Option<f64>| {
            let (error_m, radius_m) = f.error_m.zip(radius_m)?;
            Some(f64::from(u8::from(error_m <= radius_m)))
        };
        let all: Vec<&Frame> = frames.iter().collect();
        let places = places(&all);
        let interval = |groups: &[Vec<f64>], figure: fn(&[f64]) -> f64| {
            Some(grouped_bootstrap_interval(groups, figure))
                .filter(|ends| groups.len() > 1 && ends.iter().all(|end| end.is_finite()))
        };
        let covered = by_place(&places, |f| is_inside(f, f.radius95_m));
        let fix_errors = values(&|f| f.error_m);
        let gps = values(&|f| f.gps_error_m);
        let receivers = frames.iter().filter(|f| f.has_receiver).count();
        let times: Vec<f64> = frames.iter().filter_map(|f| f.time_ms).collect();
        Self {
            frames: frames.len(),
            fixes: fixes.len(),
            within_5m: share_within(&errors, 5.0),
            within_10m: share_within(&errors, 10.0),
            within_20m: share_within(&errors, 20.0),
            within_25m: share_within(&errors, 25.0),
            within_5m_interval: grouped_share_interval(&by_place(&places, |f| {
                Some(f64::from(u8::from(error_of(f) <= 5.0)))
            })),
            median_m: percentile(&errors, 0.5),
            p90_m: percentile(&errors, 0.9),
            ale_m: mean(&fix_errors),
            bias_east_m: mean_of(&|f| f.error_east_m),
            bias_north_m: mean_of(&|f| f.error_north_m),
            confidently_wrong: fixes.iter().filter(|f| confidently_wrong(f)).count(),
            beyond_3_sigma: fixes.iter().filter(|f| is_beyond_3_sigma(f)).count(),
            availability: fixes.len() as f64 / frames.len().max(1) as f64,
            precision: (!fixes.is_empty()).then(|| share_within(&fix_errors, 20.0)),
            coverage_50: mean_of(&|f| is_inside(f, f.radius50_m)),
            coverage_90: mean_of(&|f| is_inside(f, f.radius90_m)),
            coverage_95: mean(&covered.concat()),
            coverage_95_interval: (!covered.is_empty()).then(|| grouped_share_interval(&covered)),
            coverage_95_with_truth_error: mean_of(&|f| is_inside(f, f.radius95_with_truth_m)),
            radius95_median_m: percentile(&values(&|f| f.radius95_m), 0.5),
            risk_coverage_area: risk_coverage::area(frames),
            median_interval_m: interval(&by_place(&places, |f| Some(error_of(f))), |sample| {
                percentile(sample, 0.5).unwrap_or(f64::INFINITY)
            }),
            ale_interval_m: interval(&by_place(&places, |f| f.error_m), |sample| {
                mean(sample).unwrap_or(f64::INFINITY)
            }),
            gps_median_m: percentile(&gps, 0.5),
            gps_ale_m: mean(&gps),
            gps_within_20m: (receivers > 0)
                .then(|| gps.iter().filter(|e| **e <= 20.0).count() as f64 / receivers as f64),
            stage_p50_p95_ms: stages(frames),
            time_p50_ms: percentile(&times, 0.5),
            time_p95_ms: percentile(&times, 0.95),
        }
    }
}

fn is_beyond_3_sigma(frame: &Frame) -> bool {
    let sigma2 = CONFIDENTLY_WRONG_SIGMA * CONFIDENTLY_WRONG_SIGMA;
    frame.mahalanobis2.is_some_and(|m| m > sigma2)
}

fn confidently_wrong(frame: &Frame) -> bool {
    let Some(error) = frame.error_m else {
        return false;
    };
    // Within the success radius a fix is useful even if its covariance was too small.
    error > CONFIDENTLY_WRONG_M || error > 20.0 && is_beyond_3_sigma(frame)
}

/// Median and 95th percentile of the time of each stage.
fn stages(frames: &[Frame]) -> BTreeMap<String, [f64; 2]> {
    let mut all: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (stage, ms) in frames.iter().flat_map(|f| &f.stage_ms) {
        all.entry(stage).or_default().push(*ms);
    }
    all.into_iter()
        .filter_map(|(stage, ms)| {
            Some((
                stage.to_owned(),
                [percentile(&ms, 0.5)?, percentile(&ms, 0.95)?],
            ))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn frame(error_m: Option<f64>) -> Frame {
        Frame {
            fixed: error_m.is_some(),
            error_m,
            radius95_m: error_m.map(|_| 6.0),
            time_ms: Some(10.0),
            ..Frame::default()
        }
    }

    #[test]
    fn figures_of_a_case_done_by_hand() {
        let frames = [Some(1.0), Some(3.0), Some(8.0), Some(30.0), None].map(frame);
        let summary = Summary::of(&frames);
        assert_eq!((summary.frames, summary.fixes), (5, 4));
        assert_relative_eq!(summary.within_5m, 0.4);
        assert_relative_eq!(summary.within_10m, 0.6);
        assert_relative_eq!(summary.within_20m, 0.6);
        assert_eq!(summary.median_m, Some(8.0));
        assert_eq!(summary.p90_m, None, "a miss counts as infinite");
        assert_relative_eq!(summary.ale_m.unwrap(), 10.5);
        assert_relative_eq!(summary.coverage_95.unwrap(), 0.5);
        let [low, high] = summary.within_5m_interval;
        assert!((0.0..0.4).contains(&low) && high > 0.4, "{low} {high}");
    }

    #[test]
    fn intervals_are_by_place() {
        let of = |place: &str, error_m: f64| Frame {
            place: Some(place.to_owned()),
            ..frame(Some(error_m))
        };
        // One place right in all of its photos, one in none: either may be drawn twice.
        let two: Vec<Frame> = (0..20)
            .map(|i| of("a", 1.0 + 0.01 * f64::from(i)))
            .collect();
        let two = [two, vec![of("b", 50.0); 20]].concat();
        let summary = Summary::of(&two);
        assert_eq!(summary.within_5m_interval, [0.0, 1.0]);
        assert_eq!(summary.coverage_95_interval, Some([0.0, 1.0]));
        let [low, high] = summary.ale_interval_m.unwrap();
        assert!(low < 1.2 && high > 49.0, "{low} {high}");
        // Many photos of one place say little of others.
        let one = Summary::of(&two[..20]);
        let [low, high] = one.within_5m_interval;
        assert!(low < 0.5 && high > 0.99, "{low} {high}");
        assert_eq!((one.median_interval_m, one.ale_interval_m), (None, None));
    }

    #[test]
    fn a_photo_whose_receiver_is_not_known_is_no_miss_of_it() {
        let at = |gps_error_m, error_m| Frame {
            has_receiver: true,
            gps_error_m,
            ..frame(error_m)
        };
        let mut frames = vec![at(Some(12.0), Some(1.0)), at(None, None)];
        frames.extend([frame(Some(1.0)), frame(None)]);
        assert_eq!(Summary::of(&frames).gps_within_20m, Some(0.5));
        assert_eq!(Summary::of(&frames[1..]).gps_within_20m, Some(0.0));
        assert_eq!(Summary::of(&frames[2..]).gps_within_20m, None);
    }

    #[test]
    fn no_frames_give_no_figures() {
        let summary = Summary::of(&[]);
        assert_eq!(
            (summary.frames, summary.median_m, summary.ale_m),
            (0, None, None)
        );
    }
}
