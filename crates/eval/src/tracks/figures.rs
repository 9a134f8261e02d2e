//! The figures of a run.

use grimnet_track::measure::TrackSummary;
use serde::Serialize;

use crate::metrics::statistics::percentile;

/// Squared normalised errors, which are chi-square with two degrees of freedom if the covariance is right.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// How many.
    pub count: usize,
    /// Their mean; 2 is expected.
    pub mean: f64,
    /// Share below the 95 % quantile.
    pub within_95: f64,
}

/// The 95 % quantile of chi-square with two degrees of freedom, `-2 ln 0.05`.
const CHI2_95_PERCENT: f64 = 5.991_464_547_107_98;

impl Consistency {
    /// Of these values; `None` without any.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len();
        (count > 0).then(|| Self {
            count,
            mean: values.iter().sum::<f64>() / count as f64,
            within_95: values.iter().filter(|v| **v <= CHI2_95_PERCENT).count() as f64
                / count as f64,
        })
    }
}

/// How long it took from being put elsewhere to the next right answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relocalised {
    /// Seconds.
    pub seconds: f64,
    /// Frames.
    pub frames: f64,
}

/// One run: errors, availability, and how often stated radii hold, per instant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunFigures {
    /// Per instant.
    #[serde(flatten)]
    pub track: TrackSummary,
    /// Median time from the start, whose place is not given, to the first right answer, seconds; a flight without one counts as
    /// infinite.
    pub first_fix_s: Option<f64>,
    /// Median time from being put elsewhere to the next right answer, seconds. `None` if there was none.
    pub relocalise_s: Option<f64>,
    /// The same in frames of the flight's rate.
    pub relocalise_frames: Option<f64>,
    /// The longest of the times.
    pub relocalise_longest_s: Option<f64>,
    /// Flights in which there was no right answer after being put elsewhere.
    pub not_relocalised: usize,
    /// Normalised innovations squared of the accepted fixes; the filter only. They are gated at 13.8, so their mean is a little
    /// below 2 if all is right.
    pub nis: Option<Consistency>,
}

impl RunFigures {
    /// Puts the figures together.
    #[must_use]
    pub fn new(
        track: TrackSummary,
        first_fix_s: &[f64],
        relocalise: &[Relocalised],
        not_relocalised: usize,
        nis: &[f64],
    ) -> Self {
        let of = |value: fn(&Relocalised) -> f64| relocalise.iter().map(value).collect::<Vec<_>>();
        let (seconds, frames) = (of(|r| r.seconds), of(|r| r.frames));
        Self {
            track,
            first_fix_s: percentile(first_fix_s, 0.5),
            relocalise_s: percentile(&seconds, 0.5),
            relocalise_frames: percentile(&frames, 0.5),
            relocalise_longest_s: percentile(&seconds, 1.0),
            not_relocalised,
            nis: Consistency::of(nis),
        }
    }
}

/// The runs that are always compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ThreeFigures {
    /// Flights.
    pub flights: usize,
    /// Hours flown.
    pub hours: f64,
    /// The last fix, held until the next frame's is due.
    pub fixes_only: RunFigures,
    /// The control: the autopilot's velocity added up from the true start.
    pub motion_only: RunFigures,
    /// The filter.
    pub filter: RunFigures,
    /// The control without velocity: motion between frames added up.
    pub motion_only_without_velocity: RunFigures,
    /// The filter with motion between frames in place of the autopilot's velocity.
    pub filter_without_velocity: RunFigures,
}

impl ThreeFigures {
    /// The runs with their names.
    #[must_use]
    pub fn runs(&self) -> [(&'static str, &RunFigures); 5] {
        [
            ("fixes only", &self.fixes_only),
            ("motion only", &self.motion_only),
            ("filter", &self.filter),
            (
                "motion only, between frames",
                &self.motion_only_without_velocity,
            ),
            ("filter without velocity", &self.filter_without_velocity),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn consistency_of_a_case_done_by_hand() {
        let consistency = Consistency::of(&[1.0, 2.0, 9.0]).unwrap();
        assert_eq!((consistency.count, consistency.mean), (3, 4.0));
        assert!((consistency.within_95 - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!(Consistency::of(&[]), None);
    }
}
