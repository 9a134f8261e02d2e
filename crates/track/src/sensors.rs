//! The latest attitude, height and velocity, which all hypotheses share.

use grimnet_geo::turn_deg;
use nalgebra::Vector2;

use crate::{
    attitude::Attitude,
    input::{Height, Input, PositionFix, RelativeMotion, Velocity},
    options::TrackOptions,
    tilt::{CentreOffset, gsd_over_nadir},
};

/// An attitude older than this says nothing of a photo, seconds.
const ATTITUDE_HOLD_S: f64 = 0.5;
/// A height older than this says nothing of a photo, seconds.
const HEIGHT_HOLD_S: f64 = 10.0;
/// How far roll and pitch may be off what is extrapolated from the last two attitudes, degrees per second of their age.
const ATTITUDE_SPREAD_DEG_S: f64 = 5.0;

/// Where a fix's ground resolution and the reported height differ by a larger factor, the focal length or the height is wrong and not a
/// roof in the way: the surface is then taken to be as far away as the height says.
const MOST_RELIEF: f64 = 1.35;

/// What sensors other than the camera reported last.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sensors {
    telemetry: Telemetry,
    velocity: Option<Velocity>,
    /// What was known at the latest frame and at the one before, and their times.
    frames: [Option<(f64, Telemetry)>; 2],
}

/// What is known of the direction and the height of photos.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Telemetry {
    previous_attitude: Option<Attitude>,
    attitude: Option<Attitude>,
    height: Option<Height>,
}

/// What is known of the direction in which a photo was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum View {
    /// Attitude and height are known: the aircraft is found from the image centre.
    Attitude {
        attitude: Attitude,
        height_agl_m: f64,
        /// How far the surface in the photo is below the camera, metres: roofs are nearer than the ground.
        seen_below_m: f64,
        /// Error that comes from the attitude's age, degrees.
        sigma_deg: f64,
    },
    /// The height is known: the aircraft is within an unknown tilt of the image centre.
    Height { height_agl_m: f64 },
    /// Neither is known: the position is that of the image centre.
    Centre,
}

impl Sensors {
    /// Takes in an input that is for the sensors. Gives the time of the attitude before and the turn since, or the time of the
    /// height and the factor by which it changed.
    pub fn take(&mut self, input: &Input) -> Option<(f64, f64)> {
        match input {
            Input::Attitude(attitude) => self.telemetry.set_attitude(*attitude),
            Input::Height(height) => Some((height.time_s, self.telemetry.set_height(*height)?)),
            Input::Velocity(velocity) => {
                self.velocity = Some(*velocity);
                None
            }
            Input::Motion(_) | Input::Fix(_) | Input::Miss(_) => {
                self.keep_frame(input.time_s());
                None
            }
        }
    }

    /// Keeps what is known at the time of a frame.
    fn keep_frame(&mut self, time_s: f64) {
        let [latest, before] = &mut self.frames;
        if latest.is_some_and(|(latest_s, _)| latest_s < time_s) {
            *before = *latest;
        }
        *latest = Some((time_s, self.telemetry));
    }

    /// How the two photos of a motion were directed that was just taken in. Where the first is not known any more, it is as the
    /// second.
    pub fn views_of(
        &self,
        motion: &RelativeMotion,
        gsd_m: Option<f64>,
        options: &TrackOptions,
    ) -> [View; 2] {
        let first = self
            .frames
            .iter()
            .flatten()
            .find(|(time_s, _)| *time_s == motion.from_time_s)
            .map_or(self.telemetry, |(_, telemetry)| *telemetry);
        [(first, motion.from_time_s), (self.telemetry, motion.time_s)]
            .map(|(telemetry, time_s)| telemetry.view(time_s, gsd_m, options))
    }

    /// The velocity, if it is not older than `hold_s`.
    pub fn velocity_at(&self, time_s: f64, hold_s: f64) -> Option<Velocity> {
        self.velocity.filter(|v| time_s - v.time_s <= hold_s)
    }

    /// Height above mean sea level, metres.
    pub fn amsl_m(&self) -> Option<f64> {
        self.telemetry.height.and_then(|height| height.amsl_m)
    }

    /// Height above ground, metres.
    pub fn agl_m(&self, time_s: f64) -> Option<f64> {
        self.telemetry.agl_m(time_s)
    }

    /// The yaw of the latest attitude, if it is recent.
    pub fn yaw_deg(&self, time_s: f64) -> Option<f64> {
        self.telemetry
            .attitude
            .filter(|attitude| time_s - attitude.time_s <= ATTITUDE_HOLD_S)
            .map(|attitude| attitude.yaw_deg)
    }

    /// Ground resolution at the centre of a photo taken at `time_s` over that straight below; 1 if no attitude is known.
    pub fn gsd_over_nadir(&self, time_s: f64) -> f64 {
        self.telemetry.gsd_over_nadir(time_s)
    }

    /// How a photo taken at `time_s` with this ground resolution straight below was directed.
    pub fn view(&self, time_s: f64, gsd_m: Option<f64>, options: &TrackOptions) -> View {
        self.telemetry.view(time_s, gsd_m, options)
    }

    /// How a photo with `fix` was directed. Its ground resolution, straight below, tells how far the surface is that was matched
    /// with the map.
    pub fn view_of(&self, fix: &PositionFix, options: &TrackOptions) -> View {
        let mut view = self.view(fix.time_s, Some(fix.gsd_m), options);
        if let View::Attitude {
            height_agl_m,
            seen_below_m,
            ..
        } = &mut view
            && let Some(focal_length_px) = options.focal_length_px
        {
            let measured_m = fix.gsd_m * focal_length_px;
            if (measured_m / *height_agl_m).ln().abs() < MOST_RELIEF.ln() {
                *seen_below_m = measured_m;
            }
        }
        view
    }

    /// A fix with the ground resolution straight below, which tilt does not change and which hypotheses know.
    pub fn with_nadir_gsd(&self, fix: &PositionFix) -> PositionFix {
        PositionFix {
            gsd_m: fix.gsd_m / self.gsd_over_nadir(fix.time_s),
            ..*fix
        }
    }
}

impl Telemetry {
    /// Takes in an attitude. Gives the turn from the one before, if that is recent: its time and degrees clockwise.
    fn set_attitude(&mut self, attitude: Attitude) -> Option<(f64, f64)> {
        self.previous_attitude = self.attitude.replace(attitude);
        self.previous_attitude
            .filter(|before| attitude.time_s - before.time_s < 1.0)
            .map(|before| (before.time_s, turn_deg(before.yaw_deg, attitude.yaw_deg)))
    }

    /// Takes in a height. Gives the ratio to the one before.
    fn set_height(&mut self, height: Height) -> Option<f64> {
        self.height
            .replace(height)
            .filter(|before| height.time_s - before.time_s < HEIGHT_HOLD_S)
            .map(|before| height.agl_m / before.agl_m)
    }

    fn agl_m(&self, time_s: f64) -> Option<f64> {
        self.height
            .filter(|height| time_s - height.time_s <= HEIGHT_HOLD_S)
            .map(|height| height.agl_m)
    }

    fn gsd_over_nadir(&self, time_s: f64) -> f64 {
        self.attitude
            .filter(|attitude| time_s - attitude.time_s <= ATTITUDE_HOLD_S)
            .map_or(1.0, |attitude| {
                gsd_over_nadir(&self.extrapolated(attitude, time_s))
            })
    }

    fn view(&self, time_s: f64, gsd_m: Option<f64>, options: &TrackOptions) -> View {
        let from_gsd_m = || Some(gsd_m? * options.focal_length_px?);
        let Some(height_agl_m) = self.agl_m(time_s).or_else(from_gsd_m) else {
            return View::Centre;
        };
        let Some(attitude) = self
            .attitude
            .filter(|attitude| time_s - attitude.time_s <= ATTITUDE_HOLD_S)
        else {
            return View::Height { height_agl_m };
        };
        let (attitude, age_s) = (
            self.extrapolated(attitude, time_s),
            time_s - attitude.time_s,
        );
        if CentreOffset::new(&attitude, Vector2::zeros(), height_agl_m).is_none() {
            return View::Height { height_agl_m };
        }
        View::Attitude {
            attitude,
            height_agl_m,
            seen_below_m: height_agl_m,
            sigma_deg: ATTITUDE_SPREAD_DEG_S * age_s,
        }
    }

    fn extrapolated(&self, latest: Attitude, time_s: f64) -> Attitude {
        let Some(before) = self.previous_attitude else {
            return Attitude { time_s, ..latest };
        };
        let interval_s = latest.time_s - before.time_s;
        if interval_s <= 0.0 || interval_s > ATTITUDE_HOLD_S {
            return Attitude { time_s, ..latest };
        }
        let share = (time_s - latest.time_s) / interval_s;
        let ahead = |from_deg: f64, to_deg: f64| to_deg + share * turn_deg(from_deg, to_deg);
        Attitude {
            time_s,
            yaw_deg: ahead(before.yaw_deg, latest.yaw_deg),
            pitch_deg: ahead(before.pitch_deg, latest.pitch_deg),
            roll_deg: ahead(before.roll_deg, latest.roll_deg),
        }
    }
}
