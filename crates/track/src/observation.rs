//! How a hypothesis sees a fix.

use nalgebra::{Matrix2, Vector2};

use crate::{
    attitude::Attitude,
    hypothesis::{Hypothesis, PositionOf},
    input::PositionFix,
    kalman::{BORESIGHT, MAP, Observation, POSITION, TILT, UNKNOWN_TILT, set_diagonal},
    options::TrackOptions,
    scalar::{GsdFilter, HeadingFilter},
    sensors::View,
    tilt::CentreOffset,
};

/// Where the height becomes known after fixes without it, or is not known any more, the aircraft is within this tilt of the image
/// centre, degrees.
const CENTRE_TO_AIRCRAFT_DEG: f64 = 20.0;

/// What a fix should be according to a hypothesis, and what it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Innovation {
    measured_minus_predicted_m: Vector2<f64>,
    observation: Observation,
    covariance_m2: Matrix2<f64>,
    /// Covariance of the fix by itself, with everything but position and velocity.
    pub own_determinant_m4: f64,
    /// Squared Mahalanobis distance.
    pub chi2: f64,
    /// Density of the fix, per square metre.
    pub density_m2: f64,
}

/// What point a position is that is measured in a view.
pub(crate) fn position_of(view: View) -> PositionOf {
    match view {
        View::Attitude { .. } => PositionOf::Aircraft,
        View::Height { .. } => PositionOf::AircraftWithoutAttitude,
        View::Centre => PositionOf::ImageCentre,
    }
}

/// By how much the boresight and the error of the view's tilt move the image centre, metres for one radian.
///
/// It depends on what was reported and on nothing that is estimated: a fix and the motions before and after it must see the same
/// boresight, or the differences would pass for knowledge of it.
pub(crate) fn lean(view: View) -> Observation {
    let mut lean = Observation::zeros();
    let mut set = |at: usize, block: &Matrix2<f64>| {
        lean.fixed_columns_mut::<2>(at).copy_from(block);
    };
    match view {
        View::Attitude {
            attitude,
            height_agl_m,
            ..
        } => {
            let straight = Vector2::zeros();
            if let Some(centre) = CentreOffset::new(&attitude, straight, height_agl_m) {
                set(BORESIGHT, &centre.by_boresight_m);
                set(TILT, &centre.by_tilt_m);
            }
        }
        View::Height { height_agl_m } => {
            set(UNKNOWN_TILT, &(Matrix2::identity() * height_agl_m));
        }
        View::Centre => {}
    }
    lean
}

/// By how much the image centre is off where it would be on the ground, metres east and north: a tilted view meets roofs before
/// the ground. The boresight is not in it: fixes and motions must see the same one (see [`lean`]).
fn relief_m(attitude: &Attitude, height_agl_m: f64, seen_below_m: f64) -> Vector2<f64> {
    let straight = CentreOffset::new(attitude, Vector2::zeros(), height_agl_m);
    straight.map_or(Vector2::zeros(), |centre| {
        centre.offset_en_m * (seen_below_m / height_agl_m - 1.0)
    })
}

impl Innovation {
    /// Determinant of the innovation's covariance.
    pub fn determinant_m4(&self) -> f64 {
        self.covariance_m2.determinant()
    }
}

impl Hypothesis {
    /// Prepares for a measurement seen in a view, which may be of another point than those before.
    pub fn look(&mut self, view: View) {
        let position_of = position_of(view);
        if let View::Attitude { height_agl_m, .. } | View::Height { height_agl_m } = view {
            self.height_agl_m = Some(height_agl_m);
        }
        let is_another_point = (position_of == PositionOf::ImageCentre)
            != (self.position_of == PositionOf::ImageCentre);
        if is_another_point
            && self.fixes > 0
            && let Some(height_agl_m) = self.height_agl_m
        {
            let apart_m = height_agl_m * CENTRE_TO_AIRCRAFT_DEG.to_radians().tan();
            for axis in POSITION..POSITION + 2 {
                self.covariance[(axis, axis)] += apart_m * apart_m;
            }
        }
        self.position_of = position_of;
    }

    /// Takes in how large the map's error is, from the first fix that the hypothesis sees: a start is known without a map.
    pub fn know_map_error(&mut self, fix: &PositionFix) {
        if self.covariance[(MAP, MAP)] <= 0.0 {
            set_diagonal(&mut self.covariance, MAP, fix.map_error_m.powi(2));
        }
    }

    /// Predicted image centre (metres), how it depends on the state, and the noise of a measurement of it.
    pub(crate) fn measurement(
        &self,
        fix: &PositionFix,
        view: View,
        options: &TrackOptions,
    ) -> (Vector2<f64>, Observation, Matrix2<f64>) {
        let [ee, en, nn] = fix.covariance_en_m2;
        let mut noise = Matrix2::new(ee, en, en, nn);
        // A map that is worse than that of the first fix: the difference is treated as noise.
        let excess = fix.map_error_m.powi(2) - self.covariance[(MAP, MAP)];
        if excess > 0.0 {
            noise += Matrix2::identity() * excess;
        }
        let (predicted_m, observation, view_noise) = self.seen(view, options);
        (predicted_m, observation, noise + view_noise)
    }

    /// The image centre in a view, metres, how it depends on the state, and its noise that comes from the view.
    pub fn seen(
        &self,
        view: View,
        options: &TrackOptions,
    ) -> (Vector2<f64>, Observation, Matrix2<f64>) {
        let mut observation = Observation::zeros();
        let mut set = |at: usize, block: &Matrix2<f64>| {
            observation.fixed_columns_mut::<2>(at).copy_from(block);
        };
        set(POSITION, &Matrix2::identity());
        set(MAP, &Matrix2::identity());
        let mut predicted_m = self.position_m() + self.mean.fixed_rows::<2>(MAP);
        let [tilt_rad, unknown_tilt_rad] =
            [TILT, UNKNOWN_TILT].map(|at| self.mean.fixed_rows::<2>(at).into_owned());
        let mut noise = Matrix2::zeros();
        match view {
            View::Attitude {
                attitude,
                height_agl_m,
                seen_below_m,
                reference_step_m,
                sigma_deg,
                heading_deg,
            } => {
                let boresight_rad = self.mean.fixed_rows::<2>(BORESIGHT).into_owned();
                // The heading from fixes is better than a compass. That of this fix comes first: with the one from before a turn that
                // nothing told, the offset would point elsewhere by more than its linearised error holds.
                let mut heading = self.heading_at(attitude.time_s);
                if let (Some(heading), Some(measured_deg)) = (&mut heading, heading_deg) {
                    heading.update(measured_deg, options.heading_sigma_deg);
                }
                let attitude = Attitude {
                    yaw_deg: heading.map_or(attitude.yaw_deg, |heading| heading.heading_deg),
                    ..attitude
                };
                let yaw_sigma_deg =
                    heading.map_or(options.compass_sigma_deg, |heading| heading.sigma_deg());
                if let Some(centre) = CentreOffset::new(&attitude, boresight_rad, height_agl_m) {
                    predicted_m += centre.offset_en_m + centre.by_tilt_m * tilt_rad;
                    predicted_m += relief_m(&attitude, height_agl_m, seen_below_m);
                    let by_yaw_m = Vector2::new(centre.offset_en_m.y, -centre.offset_en_m.x);
                    noise += by_yaw_m * by_yaw_m.transpose() * yaw_sigma_deg.to_radians().powi(2);
                    noise += centre.offset_en_m
                        * centre.offset_en_m.transpose()
                        * (options.height_sigma.powi(2)
                            + (reference_step_m / height_agl_m).powi(2));
                    noise += centre.by_tilt_m
                        * centre.by_tilt_m.transpose()
                        * sigma_deg.to_radians().powi(2);
                }
            }
            View::Height { height_agl_m } => predicted_m += unknown_tilt_rad * height_agl_m,
            View::Centre => {}
        }
        observation += lean(view);
        (predicted_m, observation, noise)
    }

    /// Compares a fix with the hypothesis, which must have been carried to the fix's time. `None` if the covariance is
    /// singular.
    pub fn innovation(
        &self,
        fix: &PositionFix,
        measured_m: Vector2<f64>,
        view: View,
        options: &TrackOptions,
    ) -> Option<Innovation> {
        let (predicted_m, observation, noise) = self.measurement(fix, view, options);
        let covariance_m2 = observation * self.covariance * observation.transpose() + noise;
        let inverse = covariance_m2.try_inverse()?;
        let difference_m = measured_m - predicted_m;
        let chi2 = (difference_m.transpose() * inverse * difference_m)[(0, 0)];
        let determinant = covariance_m2.determinant();
        if !(determinant > 0.0 && chi2.is_finite()) {
            return None;
        }
        let map = self.covariance.fixed_view::<2, 2>(MAP, MAP);
        // Both tilts, of which the view has one.
        let by_tilt = observation.fixed_columns::<4>(TILT);
        let tilt = by_tilt * self.covariance.fixed_view::<4, 4>(TILT, TILT) * by_tilt.transpose();
        Some(Innovation {
            measured_minus_predicted_m: difference_m,
            observation,
            covariance_m2,
            own_determinant_m4: (noise + map + tilt).determinant(),
            chi2,
            density_m2: (-0.5 * chi2).exp() / (std::f64::consts::TAU * determinant.sqrt()),
        })
    }

    /// Takes in a fix.
    pub fn accept(&mut self, fix: &PositionFix, innovation: &Innovation, options: &TrackOptions) {
        self.measure(
            &innovation.observation,
            innovation.measured_minus_predicted_m,
            innovation.covariance_m2,
        );
        self.take_heading_and_gsd(fix, options);
        self.fixes = self.fixes.saturating_add(1);
        self.last_fix_s = Some(fix.time_s);
        self.distance_since_fix_m = 0.0;
    }

    pub(crate) fn take_heading_and_gsd(&mut self, fix: &PositionFix, options: &TrackOptions) {
        self.spread_heading(fix.time_s);
        if let Some(measured_deg) = fix.heading_deg {
            match &mut self.heading {
                Some(heading) => heading.update(measured_deg, options.heading_sigma_deg),
                None => {
                    self.heading =
                        Some(HeadingFilter::new(measured_deg, options.heading_sigma_deg));
                    self.heading_time_s = fix.time_s;
                }
            }
        }
        match &mut self.gsd {
            Some(gsd) => gsd.update(fix.gsd_m, options.gsd_sigma),
            None => self.gsd = Some(GsdFilter::new(fix.gsd_m, options.gsd_sigma)),
        }
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::{LonLat, destination_en_m, offset_en_m, turn_deg};

    use super::*;
    use crate::{
        input::{Height, Input, tests::fix},
        options::Start,
        tracker::Tracker,
    };

    /// In a view that is tilted ahead and to the side the photo's top is turned from the yaw on the ground.
    #[test]
    fn the_heading_of_a_fix_in_a_tilted_view_is_that_of_the_photos_top() {
        let attitude = Attitude {
            time_s: 0.0,
            yaw_deg: 0.0,
            pitch_deg: 20.0,
            roll_deg: 20.0,
        };
        let centre = CentreOffset::new(&attitude, Vector2::zeros(), 120.0).unwrap();
        let [ahead_e_m, ahead_n_m] = [0, 1].map(|axis| centre.by_boresight_m[(axis, 0)]);
        let top_deg = ahead_e_m.atan2(ahead_n_m).to_degrees();
        assert!((-7.2..-7.0).contains(&top_deg), "{top_deg}");
        let place = LonLat::new(120.7, 24.2);
        let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
        for number in 0..10 {
            let time_s = f64::from(number);
            let inputs = [
                Input::Attitude(Attitude { time_s, ..attitude }),
                Input::Height(Height {
                    time_s,
                    agl_m: 120.0,
                    amsl_m: None,
                }),
                Input::Fix(PositionFix {
                    time_s,
                    lonlat: destination_en_m(place, centre.offset_en_m.x, centre.offset_en_m.y),
                    heading_deg: Some(top_deg),
                    ..fix()
                }),
            ];
            for input in inputs {
                tracker.push(input).unwrap();
            }
        }
        let estimate = tracker
            .point_at(9.0)
            .and_then(|point| point.estimate)
            .unwrap();
        let found = LonLat::new(estimate.lon_deg, estimate.lat_deg);
        let (east_m, north_m) = offset_en_m(place, found);
        assert!(east_m.hypot(north_m) < 0.5, "{east_m} {north_m}");
        assert!(turn_deg(0.0, estimate.heading_deg.unwrap()).abs() < 0.5);
        let window = tracker.search(9.0, 50.0).windows[0];
        let (expected_deg, _) = window.heading_deg.unwrap();
        assert!(
            turn_deg(top_deg, expected_deg).abs() < 0.5,
            "{expected_deg}"
        );
    }

    #[test]
    fn after_a_start_the_maps_error_does_not_average_away() {
        let stated_m = |start: Option<Start>, map_error_m: f64| {
            let mut tracker = Tracker::new(TrackOptions {
                start,
                ..TrackOptions::default()
            })
            .unwrap();
            for number in 0..60 {
                let fix = PositionFix {
                    time_s: f64::from(number),
                    map_error_m,
                    ..fix()
                };
                tracker.push(Input::Fix(fix)).unwrap();
            }
            let [ee, _, nn] = tracker
                .point_at(59.0)
                .and_then(|point| point.estimate)
                .unwrap()
                .covariance_en_m2;
            [ee.sqrt(), nn.sqrt()]
        };
        let start = Start {
            lonlat: fix().lonlat,
            radius95_m: 200.0,
        };
        for map_error_m in [1.0, 5.0] {
            let (with, without) = (
                stated_m(Some(start), map_error_m),
                stated_m(None, map_error_m),
            );
            for (with, without) in with.into_iter().zip(without) {
                assert!(with > map_error_m, "{with} {map_error_m}");
                assert!((with / without - 1.0).abs() < 0.02, "{with} {without}");
            }
        }
    }
}
