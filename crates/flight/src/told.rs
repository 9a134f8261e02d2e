//! Whether the telemetry is what the fixes show: its times, yaw, tilt, height and velocity.

mod delay;
mod height;
mod tilt;
mod unbelieved;
mod velocity;
mod yaw;

use grimnet_geo::{LonLat, turn_deg};
use grimnet_locate::Fix;
use grimnet_track::{Attitude, Estimate, Input};

use crate::recent::Recent;

pub use delay::DelayDoubt;
pub use height::HeightDoubt;
pub use tilt::TiltDoubt;
pub use velocity::VelocityDoubt;
pub use yaw::YawDoubt;

/// After so many searches of the whole map in a row without a fix, other headings and scales than the told ones are searched.
const VAIN_SEARCHES: u32 = 3;
/// A fix whose heading is further off the expected one does not count against velocities, degrees: it is of another place.
const SAME_HEADING_DEG: f64 = 40.0;

/// Something of the telemetry that the fixes contradict.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Doubt {
    /// Its times. The filter goes on to use them.
    Delay(DelayDoubt),
    /// Its yaw. The flight goes on without attitude: pitch and roll are about axes that are turned by as much, or about unknown ones.
    Yaw(YawDoubt),
    /// Its pitch and roll. The flight goes on without attitude.
    Tilt(TiltDoubt),
    /// Its height. The flight goes on without it.
    Height(HeightDoubt),
    /// Its velocities. The flight goes on without them.
    Velocity(VelocityDoubt),
}

impl Doubt {
    /// What is doubted, in a word or two.
    pub fn of(&self) -> &'static str {
        match self {
            Self::Delay(_) => "times of the telemetry",
            Self::Yaw(_) => "yaw",
            Self::Tilt(_) => "tilt",
            Self::Height(_) => "height",
            Self::Velocity(_) => "velocity",
        }
    }
}

impl std::fmt::Display for Doubt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Delay(doubt) => doubt.fmt(f),
            Self::Yaw(doubt) => write!(f, "{doubt}; the flight goes on without attitude"),
            Self::Tilt(doubt) => write!(f, "{doubt}; the flight goes on without attitude"),
            Self::Height(doubt) => write!(f, "{doubt}; the flight goes on without them"),
            Self::Velocity(doubt) => write!(f, "{doubt}; the flight goes on without them"),
        }
    }
}

/// What was told for a photo that gave a fix.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ToldOfPhoto {
    /// Attitude of the camera, of the telemetry or of the photo's metadata.
    pub attitude: Option<Attitude>,
    /// Yaw of the telemetry, degrees.
    pub yaw_deg: Option<f64>,
    /// Height of the telemetry, metres above ground.
    pub height_agl_m: Option<f64>,
    /// Size of the photo, pixels.
    pub size_px: (u32, u32),
    /// Focal length of the photo at this size, pixels.
    pub focal_length_px: Option<f64>,
}

/// Compares telemetry with fixes.
#[derive(Debug, Clone, Default)]
pub(crate) struct Told {
    delay: delay::ToldDelay,
    yaw: yaw::ToldYaw,
    tilt: tilt::ToldTilt,
    height: height::ToldHeight,
    velocity: velocity::ToldVelocity,
}

impl Told {
    /// Takes in telemetry.
    pub fn take(&mut self, input: &Input) {
        if let Input::Velocity(velocity) = input {
            self.velocity.velocity(velocity);
        }
    }

    /// Takes in the fix of a photo, and the track at its time if that may be used. `true` if the filter was told what is doubted from
    /// now on, and has to restart.
    pub fn fix(
        &mut self,
        time_s: f64,
        fix: &Fix,
        told: &ToldOfPhoto,
        track: Option<&Estimate>,
    ) -> bool {
        let before = self.left_out();
        let expected_deg = told
            .yaw_deg
            .filter(|_| self.tells_yaw())
            .or_else(|| track?.heading_deg);
        let headings_deg = expected_deg.zip(fix.heading_deg);
        self.velocity.fix(
            time_s,
            LonLat::new(fix.lon_deg, fix.lat_deg),
            track.map(|track| LonLat::new(track.lon_deg, track.lat_deg)),
            headings_deg.is_none_or(|(told, seen)| turn_deg(told, seen).abs() <= SAME_HEADING_DEG),
        );
        if let (Some(told_deg), Some(seen_deg)) = (told.yaw_deg, fix.heading_deg) {
            self.yaw.fix(told_deg, seen_deg);
        }
        if let Some(focal_px) = told.focal_length_px {
            let seen = tilt::SeenTilt::of(&fix.outline_lonlat_deg, told.size_px, focal_px);
            if let (Some(seen), Some(attitude)) = (seen, &told.attitude) {
                self.tilt.fix(seen, attitude);
            }
            if let (Some(seen), Some(told_m)) = (seen, told.height_agl_m) {
                self.height
                    .fix(fix.gsd_m * focal_px / seen.gsd_over_nadir(), told_m);
            }
        }
        before != self.left_out()
    }

    /// The track believed the last fix.
    pub fn believed(&mut self) {
        self.velocity.believed();
    }

    /// Compares the times of the fixes with what was told by now, of which there may be a new one: its time and heading.
    pub fn compare_times(&mut self, new_fix: Option<(f64, f64)>, recent: &Recent) {
        if let Some(newest_s) = recent.newest_attitude_s() {
            self.delay
                .fix(new_fix, newest_s, |time_s| recent.nearest(time_s));
        }
    }

    /// Whether other headings than the told one are to be searched as well, after so many searches of the whole map in a row without
    /// a fix.
    pub fn tests_yaw(&self, vain_searches: u32) -> bool {
        vain_searches >= VAIN_SEARCHES && !self.yaw.is_confirmed()
    }

    /// Whether other scales than the told height's are.
    pub fn tests_height(&self, vain_searches: u32) -> bool {
        vain_searches >= VAIN_SEARCHES && !self.height.is_confirmed()
    }

    /// Whether the yaw is told to searches.
    pub fn tells_yaw(&self) -> bool {
        self.yaw.doubt().is_none()
    }

    /// Whether the filter goes without attitude.
    pub fn leaves_out_attitude(&self) -> bool {
        self.tilt.doubt().is_some() || self.yaw.doubt().is_some()
    }

    /// Whether searches and filter go without height.
    pub fn leaves_out_height(&self) -> bool {
        self.height.doubt().is_some()
    }

    /// Whether the filter goes without velocities.
    fn leaves_out_velocity(&self) -> bool {
        self.velocity.doubt().is_some()
    }

    fn left_out(&self) -> [bool; 3] {
        [
            self.leaves_out_attitude(),
            self.leaves_out_height(),
            self.leaves_out_velocity(),
        ]
    }

    /// Whether the filter is not given this.
    pub fn leaves_out(&self, input: &Input) -> bool {
        match input {
            Input::Attitude(_) => self.leaves_out_attitude(),
            Input::Height(_) => self.leaves_out_height(),
            Input::Velocity(_) => self.leaves_out_velocity(),
            _ => false,
        }
    }

    /// All that is doubted.
    pub fn doubts(&self) -> impl Iterator<Item = Doubt> {
        [
            self.delay.doubt().map(Doubt::Delay),
            self.yaw.doubt().map(Doubt::Yaw),
            self.tilt.doubt().map(Doubt::Tilt),
            self.height.doubt().map(Doubt::Height),
            self.velocity.doubt().map(Doubt::Velocity),
        ]
        .into_iter()
        .flatten()
    }
}

/// The middle value; NaN of none.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_fix_has_confirmed_is_tested_after_three_vain_searches() {
        let mut told = Told::default();
        for tests in [Told::tests_yaw, Told::tests_height] {
            assert!(!tests(&told, 2));
            assert!(tests(&told, 3));
        }
        told.yaw.fix(355.0, 20.0);
        told.height.fix(100.0, 110.0);
        for tests in [Told::tests_yaw, Told::tests_height] {
            assert!(!tests(&told, 9), "water gives no fix either");
        }
    }
}
