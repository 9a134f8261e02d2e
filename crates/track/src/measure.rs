//! How good a track is, per instant of time and not per fix: errors, availability, gaps, honesty of the covariance.

use grimnet_geo::{LonLat, offset_en_m};
use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use crate::{point::TrackPoint, smoother::SmoothedPoint};

/// An answer further off than so many times its 95 % radius is confidently wrong.
pub const CONFIDENTLY_WRONG_RADII: f64 = 3.0;
/// An answer with a radius below this counts as available for the longest gap and for relocalisation, metres.
pub const AVAILABLE_RADIUS_M: f64 = 25.0;

/// One instant: what was answered, compared with the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Seconds.
    pub time_s: f64,
    /// The answer. `None` where there was none that may be used.
    pub answer: Option<Answer>,
}

/// An answer compared with the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Answer minus truth, metres east and north.
    pub error_en_m: [f64; 2],
    /// Stated covariance, square metres: east-east, east-north, north-north.
    pub covariance_en_m2: [f64; 3],
    /// Stated 95 % radius, metres.
    pub radius95_m: f64,
}

impl Answer {
    /// Distance from the truth, metres.
    pub fn error_m(&self) -> f64 {
        self.error_en_m[0].hypot(self.error_en_m[1])
    }

    /// Normalised estimation error squared (Bar-Shalom et al. 2001, section 5.4.2): chi-square with two degrees of freedom if
    /// the covariance is right. `None` if the covariance is singular.
    pub fn nees(&self) -> Option<f64> {
        let [ee, en, nn] = self.covariance_en_m2;
        let error = Vector2::from(self.error_en_m);
        let inverse = Matrix2::new(ee, en, en, nn).try_inverse()?;
        Some((error.transpose() * inverse * error)[(0, 0)])
    }

    /// Whether it is further off than [`CONFIDENTLY_WRONG_RADII`] times its radius.
    pub fn is_confidently_wrong(&self) -> bool {
        self.error_m() > CONFIDENTLY_WRONG_RADII * self.radius95_m
    }
}

impl Instant {
    /// Compares the track with the truth. A point in a state that may not be used is no answer.
    pub fn of(point: Option<&TrackPoint>, time_s: f64, truth: LonLat) -> Self {
        let answer = point
            .filter(|point| point.state.is_usable())
            .and_then(|point| point.estimate)
            .map(|estimate| {
                let place = LonLat::new(estimate.lon_deg, estimate.lat_deg);
                let (east_m, north_m) = offset_en_m(truth, place);
                Answer {
                    error_en_m: [east_m, north_m],
                    covariance_en_m2: estimate.covariance_en_m2,
                    radius95_m: estimate.radius95_m,
                }
            });
        Self { time_s, answer }
    }
}

impl Instant {
    /// Compares a point of a smoothed track with the truth.
    pub fn of_smoothed(point: &SmoothedPoint, truth: LonLat) -> Self {
        let (east_m, north_m) = offset_en_m(truth, LonLat::new(point.lon_deg, point.lat_deg));
        Self {
            time_s: point.time_s,
            answer: Some(Answer {
                error_en_m: [east_m, north_m],
                covariance_en_m2: point.covariance_en_m2,
                radius95_m: point.radius95_m,
            }),
        }
    }
}

/// Figures over many instants.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackSummary {
    /// Instants.
    pub instants: usize,
    /// Share of instants with an answer.
    pub answered: f64,
    /// Median error of the answers, metres. `None` without answers.
    pub median_m: Option<f64>,
    /// 90th percentile of the error, metres.
    pub p90_m: Option<f64>,
    /// 99th percentile of the error, metres.
    pub p99_m: Option<f64>,
    /// Share of instants with a radius below 5 m.
    pub availability_5m: f64,
    /// Share of instants with a radius below 10 m.
    pub availability_10m: f64,
    /// Share of instants with a radius below 25 m.
    pub availability_25m: f64,
    /// Longest time without an answer with a radius below 25 m, seconds.
    pub longest_gap_s: f64,
    /// Answers that are confidently wrong.
    pub confidently_wrong: usize,
    /// Share of answers whose 50 % ellipse holds the truth.
    pub ellipse50_holds: Option<f64>,
    /// Share of answers whose 95 % ellipse holds the truth.
    pub ellipse95_holds: Option<f64>,
    /// Share of answers whose 99 % ellipse holds the truth.
    pub ellipse99_holds: Option<f64>,
    /// Mean normalised estimation error squared; 2 if the covariance is right.
    pub mean_nees: Option<f64>,
}

/// Gathers instants of one or more flights.
#[derive(Debug, Clone, Default)]
pub struct Measure {
    instants: usize,
    errors_m: Vec<f64>,
    nees: Vec<f64>,
    below_5m: usize,
    below_10m: usize,
    below_25m: usize,
    confidently_wrong: usize,
    longest_gap_s: f64,
}

impl Measure {
    /// Adds a flight: its instants in order of time.
    pub fn add_flight(&mut self, instants: &[Instant]) {
        let mut available_s = instants.first().map_or(0.0, |first| first.time_s);
        for instant in instants {
            self.instants += 1;
            let Some(answer) = &instant.answer else {
                self.longest_gap_s = self.longest_gap_s.max(instant.time_s - available_s);
                continue;
            };
            self.errors_m.push(answer.error_m());
            self.nees.extend(answer.nees());
            let below = |radius_m: f64| usize::from(answer.radius95_m < radius_m);
            self.below_5m += below(5.0);
            self.below_10m += below(10.0);
            self.below_25m += below(AVAILABLE_RADIUS_M);
            self.confidently_wrong += usize::from(answer.is_confidently_wrong());
            self.longest_gap_s = self.longest_gap_s.max(instant.time_s - available_s);
            if answer.radius95_m < AVAILABLE_RADIUS_M {
                available_s = instant.time_s;
            }
        }
    }

    /// The figures.
    pub fn summary(&self) -> TrackSummary {
        let quantile = |q: f64| percentile(&self.errors_m, q);
        let share = |count: usize| count as f64 / self.instants.max(1) as f64;
        // Chi-square with two degrees of freedom: P(x < q) = 1 - exp(-q / 2).
        let holds = |probability: f64| {
            let limit = -2.0 * (1.0 - probability).ln();
            let inside = self.nees.iter().filter(|nees| **nees <= limit).count();
            (!self.nees.is_empty()).then(|| inside as f64 / self.nees.len() as f64)
        };
        TrackSummary {
            instants: self.instants,
            answered: share(self.errors_m.len()),
            median_m: quantile(0.5),
            p90_m: quantile(0.9),
            p99_m: quantile(0.99),
            availability_5m: share(self.below_5m),
            availability_10m: share(self.below_10m),
            availability_25m: share(self.below_25m),
            longest_gap_s: self.longest_gap_s,
            confidently_wrong: self.confidently_wrong,
            ellipse50_holds: holds(0.5),
            ellipse95_holds: holds(0.95),
            ellipse99_holds: holds(0.99),
            mean_nees: (!self.nees.is_empty())
                .then(|| self.nees.iter().sum::<f64>() / self.nees.len() as f64),
        }
    }
}

/// Quantile `q` of the values, 0 to 1 (linear interpolation, numpy's default); `None` for an empty sample or if it is not
/// finite.
#[must_use]
pub fn percentile(values: &[f64], q: f64) -> Option<f64> {
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

/// Time from an event (the start of a flight, being put elsewhere) to the first answer with a radius below 25 m that is right,
/// in the sense that the truth is within its 99.9 % ellipse. `None` if there is none.
pub fn time_to_locate_s(instants: &[Instant], event_s: f64) -> Option<f64> {
    instants
        .iter()
        .filter(|instant| instant.time_s >= event_s)
        .find(|instant| {
            instant.answer.as_ref().is_some_and(|answer| {
                answer.radius95_m < AVAILABLE_RADIUS_M
                    && answer
                        .nees()
                        .is_some_and(|nees| nees < crate::options::GATE_99_9_PERCENT)
            })
        })
        .map(|instant| instant.time_s - event_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn instant(time_s: f64, error_m: f64, sigma_m: f64) -> Instant {
        let variance = sigma_m * sigma_m;
        Instant {
            time_s,
            answer: Some(Answer {
                error_en_m: [0.6 * error_m, -0.8 * error_m],
                covariance_en_m2: [variance, 0.0, variance],
                radius95_m: 2.44775 * sigma_m,
            }),
        }
    }

    #[test]
    fn figures_of_a_small_track() {
        let none = |time_s| Instant {
            time_s,
            answer: None,
        };
        let mut measure = Measure::default();
        measure.add_flight(&[
            none(0.0),
            instant(1.0, 1.0, 1.0),
            instant(2.0, 3.0, 1.0),
            instant(3.0, 10.0, 20.0),
            none(4.0),
            instant(6.5, 8.0, 1.0),
        ]);
        let summary = measure.summary();
        assert_relative_eq!(summary.answered, 4.0 / 6.0);
        assert_eq!(summary.median_m, Some(5.5));
        assert_relative_eq!(summary.p90_m.unwrap(), 9.4, epsilon = 1e-12);
        assert_relative_eq!(summary.availability_5m, 0.5);
        assert_relative_eq!(summary.availability_25m, 0.5);
        assert_relative_eq!(summary.longest_gap_s, 4.5);
        assert_eq!(summary.confidently_wrong, 1);
        assert_relative_eq!(summary.mean_nees.unwrap(), (1.0 + 9.0 + 0.25 + 64.0) / 4.0);
        // 9 is beyond the 95 % limit of 5.99, 0.25 within the 50 % limit of 1.39.
        assert_eq!(summary.ellipse95_holds, Some(0.5));
        assert_eq!(summary.ellipse50_holds, Some(0.5));
    }

    #[test]
    fn time_to_locate_wants_a_right_answer() {
        let track = [
            instant(1.0, 30.0, 1.0),
            instant(2.0, 1.0, 30.0),
            instant(3.0, 1.0, 1.0),
        ];
        assert_eq!(time_to_locate_s(&track, 0.5), Some(2.5));
        assert_eq!(time_to_locate_s(&track, 3.5), None);
    }
}
