//! The figures that the field uses, over all frames.

use grimnet_geo::{LonLat, offset_en_m};
use rand::{Rng, SeedableRng};
use serde::Serialize;

/// How one frame was answered, compared with the truth.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Frame {
    /// File name of the photo.
    pub photo: String,
    /// Whether a fix was given.
    pub fixed: bool,
    /// Distance from the true image centre in metres; none without a fix.
    pub error_m: Option<f64>,
    /// Error east of the truth in metres.
    pub error_east_m: Option<f64>,
    /// Error north of the truth in metres.
    pub error_north_m: Option<f64>,
    /// The radius that was stated to hold the truth in 95 % of cases, metres.
    pub radius95_m: Option<f64>,
    /// Squared Mahalanobis distance of the error under the stated covariance (chi-square, 2 degrees of freedom).
    pub mahalanobis2: Option<f64>,
    /// Why there is no fix.
    pub reason: Option<String>,
    /// Time from decoded photo to answer, milliseconds.
    pub time_ms: Option<f64>,
}

/// A fix as it is scored: position, and what was said about its uncertainty.
#[derive(Debug, Clone, Copy)]
pub struct ScoredFix {
    /// The stated position.
    pub position: LonLat,
    /// Stated covariance in square metres: east-east, east-north, north-north.
    pub covariance_en_m2: [f64; 3],
    /// Stated 95 % radius in metres.
    pub radius95_m: f64,
}

impl Frame {
    /// Scores one fix against the true position.
    #[must_use]
    pub fn score(photo: &str, fix: &ScoredFix, truth: LonLat) -> Self {
        let (east, north) = offset_en_m(truth, fix.position);
        let [ee, en, nn] = fix.covariance_en_m2;
        let determinant = ee * nn - en * en;
        let mahalanobis2 =
            (nn * east * east - 2.0 * en * east * north + ee * north * north) / determinant;
        Self {
            photo: photo.to_owned(),
            fixed: true,
            error_m: Some(east.hypot(north)),
            error_east_m: Some(east),
            error_north_m: Some(north),
            radius95_m: Some(fix.radius95_m),
            mahalanobis2: (determinant > 0.0).then_some(mahalanobis2),
            ..Self::default()
        }
    }

    /// A frame that was not answered.
    #[must_use]
    pub fn missed(photo: &str, reason: &str) -> Self {
        Self {
            photo: photo.to_owned(),
            reason: Some(reason.to_owned()),
            ..Self::default()
        }
    }
}

/// An error above this many metres is "confidently wrong" whatever was stated.
pub const CONFIDENTLY_WRONG_M: f64 = 100.0;

/// An error beyond this many standard deviations of the stated covariance is "confidently wrong".
pub const CONFIDENTLY_WRONG_SIGMA: f64 = 3.0;

/// Figures over all frames. A frame without a fix is a miss in every share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Frames scored.
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
    /// 95 % bootstrap interval of `within_5m`.
    pub within_5m_interval: [f64; 2],
    /// Median error over all frames, a miss counting as infinitely far; none where most frames are missed.
    pub median_m: Option<f64>,
    /// 90th percentile of the error over all frames, counted likewise.
    pub p90_m: Option<f64>,
    /// Average localisation error over the fixes (the paper's ALE).
    pub ale_m: Option<f64>,
    /// Mean error eastwards over the fixes.
    pub bias_east_m: Option<f64>,
    /// Mean error northwards over the fixes.
    pub bias_north_m: Option<f64>,
    /// Fixes that were off by more than 3 stated standard deviations and 20 m, or by more than 100 m.
    pub confidently_wrong: usize,
    /// Share of fixes whose error lies within the stated 95 % radius.
    pub coverage_95: Option<f64>,
    /// Median time per frame, milliseconds.
    pub time_p50_ms: Option<f64>,
    /// 95th percentile of the time per frame, milliseconds.
    pub time_p95_ms: Option<f64>,
}

impl Summary {
    /// Condenses frames into figures.
    #[must_use]
    pub fn of(frames: &[Frame]) -> Self {
        let errors: Vec<f64> = frames
            .iter()
            .map(|f| f.error_m.unwrap_or(f64::INFINITY))
            .collect();
        let fixes: Vec<&Frame> = frames.iter().filter(|f| f.error_m.is_some()).collect();
        let mean = |value: &dyn Fn(&Frame) -> Option<f64>| {
            let values: Vec<f64> = fixes.iter().filter_map(|f| value(f)).collect();
            (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
        };
        let times: Vec<f64> = frames.iter().filter_map(|f| f.time_ms).collect();
        Self {
            frames: frames.len(),
            fixes: fixes.len(),
            within_5m: share_within(&errors, 5.0),
            within_10m: share_within(&errors, 10.0),
            within_20m: share_within(&errors, 20.0),
            within_25m: share_within(&errors, 25.0),
            within_5m_interval: bootstrap_interval(&errors, |sample| share_within(sample, 5.0)),
            median_m: percentile(&errors, 0.5),
            p90_m: percentile(&errors, 0.9),
            ale_m: mean(&|f| f.error_m),
            bias_east_m: mean(&|f| f.error_east_m),
            bias_north_m: mean(&|f| f.error_north_m),
            confidently_wrong: fixes.iter().filter(|f| confidently_wrong(f)).count(),
            coverage_95: mean(&|f| {
                let (error, radius) = f.error_m.zip(f.radius95_m)?;
                Some(f64::from(u8::from(error <= radius)))
            }),
            time_p50_ms: percentile(&times, 0.5),
            time_p95_ms: percentile(&times, 0.95),
        }
    }
}

fn confidently_wrong(frame: &Frame) -> bool {
    let Some(error) = frame.error_m else {
        return false;
    };
    let sigma2 = CONFIDENTLY_WRONG_SIGMA * CONFIDENTLY_WRONG_SIGMA;
    // Below the success radius a fix is useful even where its covariance was too proud.
    let beyond_stated = error > 20.0 && frame.mahalanobis2.is_some_and(|m| m > sigma2);
    error > CONFIDENTLY_WRONG_M || beyond_stated
}

/// Share of values at most `limit`; zero of nothing.
fn share_within(values: &[f64], limit: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.iter().filter(|v| **v <= limit).count() as f64 / values.len() as f64
}

/// The value below which a share `q` of the values lies (linear interpolation, as numpy's default);
/// none where it is not finite.
fn percentile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let position = q * last as f64;
    let (low, high) = (
        sorted[position.floor() as usize],
        sorted[position.ceil() as usize],
    );
    let value = if low == high {
        low
    } else {
        low + (high - low) * position.fract()
    };
    value.is_finite().then_some(value)
}

/// 95 % percentile bootstrap interval (Efron 1979) of a figure, 1,000 resamples, fixed seed.
fn bootstrap_interval(values: &[f64], figure: impl Fn(&[f64]) -> f64) -> [f64; 2] {
    if values.is_empty() {
        return [0.0, 0.0];
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1979);
    let mut sample = values.to_vec();
    let figures: Vec<f64> = (0..1000)
        .map(|_| {
            for slot in &mut sample {
                *slot = values[rng.random_range(0..values.len())];
            }
            figure(&sample)
        })
        .collect();
    [0.025, 0.975].map(|q| percentile(&figures, q).unwrap_or(0.0))
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
        assert_eq!(summary.p90_m, None, "a miss lies infinitely far");
        assert_relative_eq!(summary.ale_m.unwrap(), 10.5);
        assert_relative_eq!(summary.coverage_95.unwrap(), 0.5);
        let [low, high] = summary.within_5m_interval;
        assert!((0.0..0.4).contains(&low) && high > 0.4, "{low} {high}");
    }

    #[test]
    fn no_frames_give_no_figures() {
        let summary = Summary::of(&[]);
        assert_eq!(
            (summary.frames, summary.median_m, summary.ale_m),
            (0, None, None)
        );
    }

    #[test]
    fn an_error_is_split_into_east_and_north_and_weighed_by_its_covariance() {
        let truth = LonLat {
            lon_deg: 0.0,
            lat_deg: 0.0,
        };
        // One arc second of latitude at the equator is 30.715 m (WGS 84).
        let fix = ScoredFix {
            position: LonLat {
                lon_deg: 0.0,
                lat_deg: 1.0 / 3600.0,
            },
            covariance_en_m2: [1.0, 0.0, 100.0],
            radius95_m: 20.0,
        };
        let scored = Frame::score("a.jpg", &fix, truth);
        assert_relative_eq!(scored.error_m.unwrap(), 30.715, epsilon = 1e-2);
        assert_relative_eq!(scored.error_north_m.unwrap(), 30.715, epsilon = 1e-2);
        assert_relative_eq!(scored.mahalanobis2.unwrap(), 9.434, epsilon = 1e-2);
        assert_eq!(Summary::of(&[scored]).confidently_wrong, 1);
    }
}
