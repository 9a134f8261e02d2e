//! Whether the telemetry is consistent with the fixes: its times, yaw, tilt, height and velocity.

mod agreement;
mod compared_fix;
mod confirmation;
pub(crate) mod delay;
mod displacement;
mod fix_path;
pub(crate) mod height;
mod median;
mod plane_vector;
mod reported_path;
pub(crate) mod tilt;
pub(crate) mod velocity;
#[cfg(test)]
mod velocity_tests;
pub(crate) mod yaw;

use grimnet_geo::{LonLat, destination_en_m, turn_deg};
use grimnet_locate::Fix;
use grimnet_track::{Attitude, Estimate, Input, RelativeMotion};

use self::compared_fix::PlacedFix;
use self::tilt::MeasuredTilt;
use crate::left_out::LeftOut;
use crate::recent::Recent;
use crate::warning::Warning;

pub use delay::DelayWarning;
pub use height::HeightWarning;
pub use tilt::TiltWarning;
pub use velocity::VelocityWarning;
pub use yaw::YawWarning;

/// A fix whose heading is further off the expected one does not count against velocities, degrees: it is of another place.
const SAME_HEADING_DEG: f64 = 40.0;

/// What was reported for a photo that gave a fix.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PhotoTelemetry {
    /// Attitude of the camera, of the telemetry or of the photo's metadata.
    pub attitude: Option<Attitude>,
    /// Bearing of the photo's top by the telemetry, degrees.
    pub top_deg: Option<f64>,
    /// Height of the telemetry, metres above ground.
    pub height_agl_m: Option<f64>,
    /// Size of the photo, pixels.
    pub size_px: (u32, u32),
    /// Focal length of the photo at this size, pixels.
    pub focal_length_px: Option<f64>,
}

/// Compares telemetry with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct ConsistencyChecks {
    delay: delay::DelayCheck,
    yaw: yaw::YawCheck,
    tilt: tilt::TiltCheck,
    height: height::HeightCheck,
    velocity: velocity::VelocityCheck,
}

impl ConsistencyChecks {
    /// Takes in telemetry.
    pub fn take(&mut self, input: &Input) {
        if let Input::Velocity(velocity) = input {
            self.velocity.velocity(velocity);
        }
    }

    /// Takes in the fix of a photo, and the track at its time if that may be used. `true` if the filter was given what is inconsistent
    /// from now on, and has to restart.
    pub fn fix(
        &mut self,
        time_s: f64,
        fix: &Fix,
        telemetry: &PhotoTelemetry,
        track: Option<&Estimate>,
    ) -> bool {
        let before = self.left_out_now();
        let measured_tilt = telemetry.focal_length_px.and_then(|focal_px| {
            MeasuredTilt::of(&fix.outline_lon_lat_deg, telemetry.size_px, focal_px)
        });
        let measured_height_m = telemetry
            .focal_length_px
            .zip(measured_tilt)
            .map(|(focal_px, tilt)| fix.gsd_m * focal_px / tilt.gsd_over_nadir());
        let expected_deg = telemetry
            .top_deg
            .filter(|_| self.uses_yaw())
            .or_else(|| track?.heading_deg);
        let headings_deg = expected_deg.zip(fix.heading_deg);
        let has_expected_heading = headings_deg.is_none_or(|(expected_deg, measured_deg)| {
            turn_deg(expected_deg, measured_deg).abs() <= SAME_HEADING_DEG
        });
        let placed = self.placed(time_s, fix, telemetry, measured_height_m, track);
        self.velocity.fix(placed, has_expected_heading);
        if let (Some(reported_deg), Some(measured_deg)) = (telemetry.top_deg, fix.heading_deg) {
            self.yaw.fix(reported_deg, measured_deg);
        }
        if let (Some(measured), Some(attitude)) = (measured_tilt, &telemetry.attitude) {
            self.tilt.fix(measured, attitude);
        }
        if let (Some(measured_m), Some(reported_m)) = (measured_height_m, telemetry.height_agl_m) {
            self.height.fix(measured_m, reported_m);
        }
        // What agrees again was not given.
        let now = self.left_out_now();
        (now.attitude && !before.attitude)
            || (now.height && !before.height)
            || (now.velocity && !before.velocity)
    }

    /// Where the aircraft is according to a fix, if its attitude is known, else the image centre.
    fn placed(
        &self,
        time_s: f64,
        fix: &Fix,
        telemetry: &PhotoTelemetry,
        measured_height_m: Option<f64>,
        track: Option<&Estimate>,
    ) -> PlacedFix {
        let centre = LonLat::new(fix.lon_deg, fix.lat_deg);
        let attitude = telemetry.attitude.filter(|_| !self.leaves_out_attitude());
        let offset_en_m = attitude
            .zip(measured_height_m.or(telemetry.height_agl_m))
            .and_then(|(attitude, height_m)| attitude.centre_offset_en_m(height_m));
        PlacedFix {
            time_s,
            place: offset_en_m.map_or(centre, |[east_m, north_m]| {
                destination_en_m(centre, -east_m, -north_m)
            }),
            is_of_aircraft: offset_en_m.is_some(),
            track: track.map(|track| LonLat::new(track.lon_deg, track.lat_deg)),
        }
    }

    /// The track accepted the last fix.
    pub fn accepted(&mut self) {
        self.velocity.accepted();
    }

    /// Takes in the motion from the frame before to one whose fix was taken in, if it gave one: see [`VelocityCheck::motion`].
    pub fn motion(&mut self, motion: &RelativeMotion, gsd_m: f64, is_new_picture: bool) {
        self.velocity.motion(motion, gsd_m, is_new_picture);
    }

    /// Forgets the times of all that was taken in: the clock was set.
    pub fn restart_clock(&mut self) {
        self.velocity.restart_clock();
        self.delay = delay::DelayCheck::default();
    }

    /// Compares the times of the fixes with what was reported by now, of which there may be a new one: its time and heading.
    pub fn compare_times(&mut self, new_fix: Option<(f64, f64)>, recent: &Recent) {
        if let Some(newest_s) = recent.newest_attitude_s() {
            self.delay
                .fix(new_fix, newest_s, |time_s| recent.nearest(time_s));
        }
    }

    /// The whole map was searched so often in a row without a fix.
    pub fn searched_without_fix(&mut self, searches_without_fix: u32) {
        self.yaw.searched_without_fix(searches_without_fix);
        self.height.searched_without_fix(searches_without_fix);
    }

    /// Whether other headings than the reported one are to be searched as well, after so many searches of the whole map in a row without
    /// a fix.
    pub fn tests_yaw(&self, searches_without_fix: u32) -> bool {
        self.yaw.is_tested(searches_without_fix)
    }

    /// Whether other scales than the reported height's are.
    pub fn tests_height(&self, searches_without_fix: u32) -> bool {
        self.height.is_tested(searches_without_fix)
    }

    /// Whether fixes confirmed the yaw before a gap and none since.
    pub fn yaw_is_in_doubt(&self) -> bool {
        self.yaw.is_in_doubt()
    }

    /// Whether searches use the yaw.
    pub fn uses_yaw(&self) -> bool {
        self.yaw.warning().is_none()
    }

    /// Whether the filter goes without attitude.
    pub fn leaves_out_attitude(&self) -> bool {
        self.tilt.warning().is_some() || self.yaw.warning().is_some()
    }

    /// Whether searches and filter go without height.
    pub fn leaves_out_height(&self) -> bool {
        self.height.warning().is_some()
    }

    /// Whether the filter goes without velocities.
    fn leaves_out_velocity(&self) -> bool {
        self.velocity.warning().is_some()
    }

    /// What the filter is not given now.
    pub fn left_out_now(&self) -> LeftOut {
        LeftOut {
            attitude: self.leaves_out_attitude(),
            height: self.leaves_out_height(),
            velocity: self.leaves_out_velocity(),
        }
    }

    /// What the filter was not given at any time. Attitudes and velocities may be given again.
    pub fn left_out(&self) -> LeftOut {
        let now = self.left_out_now();
        LeftOut {
            attitude: now.attitude || self.yaw.was_inconsistent(),
            velocity: self.velocity.was_inconsistent(),
            ..now
        }
    }

    /// All that is inconsistent.
    pub fn warnings(&self) -> impl Iterator<Item = Warning> {
        [
            self.delay.warning().map(Warning::Delay),
            self.yaw.warning().map(Warning::Yaw),
            self.tilt.warning().map(Warning::Tilt),
            self.height.warning().map(Warning::Height),
            self.velocity.warning().map(Warning::Velocity),
        ]
        .into_iter()
        .flatten()
    }
}

#[cfg(test)]
mod tests {
    use grimnet_track::Velocity;

    use super::*;
    use crate::position_fix::tests::fix;

    #[test]
    fn what_no_fix_has_confirmed_for_long_is_tested() {
        let mut checks = ConsistencyChecks::default();
        let are_tested = |checks: &ConsistencyChecks, searches_without_fix| {
            [
                checks.tests_yaw(searches_without_fix),
                checks.tests_height(searches_without_fix),
            ]
        };
        assert_eq!(are_tested(&checks, 2), [false; 2]);
        assert_eq!(are_tested(&checks, 3), [true; 2]);
        checks.yaw.fix(355.0, 20.0);
        checks.height.fix(100.0, 110.0);
        checks.searched_without_fix(3);
        assert_eq!(are_tested(&checks, 3), [false; 2], "confirmed");
        checks.searched_without_fix(4);
        assert_eq!(are_tested(&checks, 4), [true; 2]);
        assert_eq!(
            are_tested(&checks, 5),
            [false; 2],
            "water gives no fix either"
        );
        checks.yaw.fix(355.0, 20.0);
        assert_eq!(are_tested(&checks, 8), [false, true]);
    }

    #[test]
    fn a_yaw_that_fixes_contradict_restarts_the_filter_and_one_that_agrees_again_does_not() {
        let mut checks = ConsistencyChecks::default();
        let measured = fix([2.0, 0.0, 2.0]);
        let mut restarts = |yaw_deg: f64| {
            let telemetry = PhotoTelemetry {
                attitude: None,
                top_deg: Some(yaw_deg),
                height_agl_m: None,
                size_px: (800, 600),
                focal_length_px: None,
            };
            (0..4)
                .filter(|_| checks.fix(0.0, &measured, &telemetry, None))
                .count()
        };
        assert_eq!([210.0, 30.0].map(&mut restarts), [1, 0]);
        assert_eq!(checks.left_out_now(), LeftOut::default());
    }

    /// A flight on a wide circle whose velocities are reported as zero for the first minute.
    #[test]
    fn velocities_that_agree_again_are_given_to_the_filter_but_were_left_out() {
        let mut checks = ConsistencyChecks::default();
        let mut was_left_out = false;
        for tick in 0..2400u32 {
            let time_s = f64::from(tick) * 0.1;
            let angle_rad = time_s / 30.0;
            let speed_m_s = if time_s < 60.0 { 0.0 } else { 10.0 };
            checks.take(&Input::Velocity(Velocity {
                time_s,
                east_m_s: speed_m_s * angle_rad.cos(),
                north_m_s: speed_m_s * angle_rad.sin(),
                sigma_m_s: 0.3,
            }));
            if tick % 10 == 0 {
                let (east_m, north_m) = (300.0 * angle_rad.sin(), -300.0 * angle_rad.cos());
                let fix = PlacedFix {
                    time_s,
                    place: destination_en_m(LonLat::new(1.5, 1.0), east_m, north_m),
                    is_of_aircraft: true,
                    track: None,
                };
                checks.velocity.fix(fix, true);
                checks.accepted();
                was_left_out |= checks.left_out_now().velocity;
            }
        }
        assert!(was_left_out && !checks.left_out_now().velocity);
        assert!(checks.left_out().velocity);
        assert_eq!(checks.warnings().count(), 0);
    }
}
