//! The latest attitude, height and velocity, which all hypotheses share.

use grimnet_geo::turn_deg;

use crate::{
    attitude::Attitude,
    climb::{Climb, ReferenceStep},
    input::{Height, Input, PositionFix, RelativeMotion, Velocity},
    options::TrackOptions,
    tilt::{gsd_over_nadir, top_from_yaw_deg},
    velocity_gate::{VelocityGate, VelocityUse},
};

/// How far roll and pitch may be off what is extrapolated from the last two attitudes, degrees per second of their age.
const ATTITUDE_SPREAD_DEG_S: f64 = 5.0;
/// Two attitudes closer in time than this tell no rate, seconds: messages that arrive together may be stamped microseconds apart. It is
/// below the interval of a stream of 50 Hz.
const LEAST_RATE_INTERVAL_S: f64 = 0.015;
/// An attitude is extrapolated by no more than so many times what it changed between the last two.
const MOST_EXTRAPOLATED: f64 = 2.0;

/// A height that comes again was measured up to so long before, seconds: a sensor of 1 Hz may be reported ten times a second.
const MOST_REPEATED_S: f64 = 1.0;

/// Where a fix's ground resolution and the reported height differ by a larger factor, the focal length or the height is wrong and not a
/// roof in the way: the surface is then taken to be as far away as the height says.
const MOST_RELIEF: f64 = 1.35;

/// What sensors other than the camera reported last.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sensors {
    telemetry: Telemetry,
    velocities: VelocityGate,
    /// What was known at the latest frame and at the one before, and their times.
    frames: [Option<(f64, Telemetry)>; 2],
}

/// What is known of the direction and the height of photos.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Telemetry {
    previous_attitude: Option<Attitude>,
    attitude: Option<Attitude>,
    height: Option<Height>,
    /// Time of the first height in a row that is the same as that one, seconds.
    same_height_since_s: f64,
    /// The last step of the height's reference.
    reference_step: Option<ReferenceStep>,
}

/// What an input says beside itself, together with those before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Change {
    /// The turn since the attitude before.
    Turn {
        /// Time of that one, seconds.
        from_s: f64,
        /// Degrees clockwise.
        turn_deg: f64,
    },
    /// The climb since the height before.
    Climb(Climb),
    /// How a velocity is used.
    Velocity(VelocityUse),
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
        /// By how much that may be off because the height's reference stepped, metres, 1 sigma.
        reference_step_m: f64,
        /// Error that comes from the attitude's age, degrees.
        sigma_deg: f64,
        /// Yaw as the fix in the photo shows it, degrees clockwise from true north. `None` without a fix that does.
        heading_deg: Option<f64>,
    },
    /// The height is known: the aircraft is within an unknown tilt of the image centre.
    Height { height_agl_m: f64 },
    /// Neither is known: the position is that of the image centre.
    Centre,
}

impl Sensors {
    /// Takes in an input that is for the sensors. Gives what it changed, if it tells that: nothing for a velocity that is left out.
    pub fn take(&mut self, input: &Input) -> Option<Change> {
        match input {
            Input::Attitude(attitude) => self.telemetry.set_attitude(*attitude),
            Input::Height(height) => Some(Change::Climb(self.telemetry.set_height(*height)?)),
            Input::Velocity(velocity) => Some(Change::Velocity(self.velocities.take(velocity)?)),
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
        self.known_of(motion)
            .map(|(telemetry, time_s)| telemetry.view(time_s, gsd_m, options))
    }

    /// What was known at the two photos of a motion that was just taken in, and when they were taken.
    fn known_of(&self, motion: &RelativeMotion) -> [(Telemetry, f64); 2] {
        let first = self
            .frames
            .iter()
            .flatten()
            .find(|(time_s, _)| *time_s == motion.from_time_s)
            .map_or(self.telemetry, |(_, telemetry)| *telemetry);
        [(first, motion.from_time_s), (self.telemetry, motion.time_s)]
    }

    /// Whether a photo of an input that was just taken in looks so far off the vertical that it does not tell where the aircraft is. Such
    /// a one must not pass for one of unknown tilt: what it shows is much further away.
    pub fn looks_too_far_aside(&self, input: &Input, options: &TrackOptions) -> bool {
        match input {
            Input::Fix(fix) => self.telemetry.looks_too_far_aside(fix.time_s, options),
            Input::Motion(motion) => self
                .known_of(motion)
                .iter()
                .any(|(telemetry, time_s)| telemetry.looks_too_far_aside(*time_s, options)),
            Input::Attitude(_) | Input::Height(_) | Input::Velocity(_) | Input::Miss(_) => false,
        }
    }

    /// The velocity, if it is not older than `hold_s`.
    pub fn velocity_at(&self, time_s: f64, hold_s: f64) -> Option<Velocity> {
        let latest = self.velocities.latest();
        latest.filter(|v| time_s - v.time_s <= hold_s)
    }

    /// Height above mean sea level, metres.
    pub fn amsl_m(&self, time_s: f64) -> Option<f64> {
        self.telemetry.height_at(time_s)?.amsl_m
    }

    /// Height above ground, metres.
    pub fn agl_m(&self, time_s: f64) -> Option<f64> {
        Some(self.telemetry.height_at(time_s)?.agl_m)
    }

    /// The yaw of the latest attitude, if it is recent.
    pub fn yaw_deg(&self, time_s: f64) -> Option<f64> {
        Some(self.telemetry.latest_attitude(time_s)?.yaw_deg)
    }

    /// Ground resolution at the centre of a photo taken at `time_s` over that straight below; 1 if no attitude is known.
    pub fn gsd_over_nadir(&self, time_s: f64) -> f64 {
        self.telemetry.gsd_over_nadir(time_s)
    }

    /// Bearing of the top of a photo taken at `time_s` from the yaw, degrees clockwise; 0 if no attitude is known.
    pub fn top_from_yaw_deg(&self, time_s: f64) -> f64 {
        self.telemetry.top_from_yaw_deg(time_s)
    }

    /// How a photo taken at `time_s` with this ground resolution straight below was directed.
    pub fn view(&self, time_s: f64, gsd_m: Option<f64>, options: &TrackOptions) -> View {
        self.telemetry.view(time_s, gsd_m, options)
    }

    /// How a photo with `fix`, [levelled](Self::levelled), was directed. Its ground resolution tells how far the surface is that was
    /// matched with the map, and its heading the yaw.
    pub fn view_of(&self, fix: &PositionFix, options: &TrackOptions) -> View {
        let mut view = self.view(fix.time_s, Some(fix.gsd_m), options);
        if let View::Attitude {
            height_agl_m,
            seen_below_m,
            reference_step_m,
            heading_deg,
            ..
        } = &mut view
        {
            *heading_deg = fix.heading_deg;
            if let Some(focal_length_px) = options.focal_length_px {
                let measured_m = fix.gsd_m * focal_length_px;
                let is_relief = (measured_m / *height_agl_m).ln().abs() < MOST_RELIEF.ln();
                // After a step it is the height that is wrong.
                if is_relief || *reference_step_m > 0.0 {
                    *seen_below_m = measured_m;
                    *reference_step_m = 0.0;
                }
            }
        }
        view
    }

    /// A fix with the ground resolution straight below, and with the yaw as its heading: tilt does not change them, and hypotheses know
    /// them.
    pub fn levelled(&self, fix: &PositionFix) -> PositionFix {
        let top_from_yaw_deg = self.top_from_yaw_deg(fix.time_s);
        PositionFix {
            gsd_m: fix.gsd_m / self.gsd_over_nadir(fix.time_s),
            heading_deg: fix.heading_deg.map(|top_deg| top_deg - top_from_yaw_deg),
            ..*fix
        }
    }
}

impl Telemetry {
    /// Takes in an attitude. Gives the turn from the one before, if that is recent.
    fn set_attitude(&mut self, attitude: Attitude) -> Option<Change> {
        self.previous_attitude = self.attitude.replace(attitude);
        self.previous_attitude
            .filter(|before| attitude.time_s - before.time_s < 1.0)
            .map(|before| Change::Turn {
                from_s: before.time_s,
                turn_deg: turn_deg(before.yaw_deg, attitude.yaw_deg),
            })
    }

    /// Takes in a height. Gives the climb from the one before, if that is recent.
    fn set_height(&mut self, height: Height) -> Option<Climb> {
        let before = self.height.replace(height);
        let measured_s = self.same_height_since_s;
        if before.is_none_or(|before| before.agl_m != height.agl_m) {
            self.same_height_since_s = height.time_s;
        }
        let before = before.filter(|before| height.time_s - before.time_s < Height::HOLD_S)?;
        let measured_s = measured_s.max(before.time_s - MOST_REPEATED_S);
        let climb = Climb::between(&before, measured_s, &height);
        if let Some(by_m) = climb.reference_step_m {
            self.reference_step = ReferenceStep::next(self.reference_step, height.time_s, by_m);
        }
        Some(climb)
    }

    /// The latest height, if it is recent.
    fn height_at(&self, time_s: f64) -> Option<Height> {
        self.height
            .filter(|height| time_s - height.time_s <= Height::HOLD_S)
    }

    /// The latest attitude as it was reported, if it is recent.
    fn latest_attitude(&self, time_s: f64) -> Option<Attitude> {
        self.attitude
            .filter(|attitude| time_s - attitude.time_s <= Attitude::HOLD_S)
    }

    fn gsd_over_nadir(&self, time_s: f64) -> f64 {
        self.extrapolated(time_s)
            .map_or(1.0, |(attitude, _)| gsd_over_nadir(&attitude))
    }

    fn top_from_yaw_deg(&self, time_s: f64) -> f64 {
        self.extrapolated(time_s)
            .map_or(0.0, |(attitude, _)| top_from_yaw_deg(&attitude))
    }

    fn view(&self, time_s: f64, gsd_m: Option<f64>, options: &TrackOptions) -> View {
        let reference_step_m = self.reference_step.map_or(0.0, |step| step.by_m.abs());
        let reported = self
            .height_at(time_s)
            .map(|height| (height.agl_m, reference_step_m));
        let from_gsd = || Some((gsd_m? * options.focal_length_px?, 0.0));
        let Some((height_agl_m, reference_step_m)) = reported.or_else(from_gsd) else {
            return View::Centre;
        };
        let Some((attitude, sigma_deg)) = self.extrapolated(time_s) else {
            return View::Height { height_agl_m };
        };
        View::Attitude {
            attitude,
            height_agl_m,
            seen_below_m: height_agl_m,
            reference_step_m,
            sigma_deg,
            heading_deg: None,
        }
    }

    /// Whether the aircraft would be found from an image centre that is too far off the vertical for that. Without a height the position is
    /// that of the image centre itself.
    fn looks_too_far_aside(&self, time_s: f64, options: &TrackOptions) -> bool {
        let has_height = self.height_at(time_s).is_some() || options.focal_length_px.is_some();
        let attitude = self.extrapolated(time_s).filter(|_| has_height);
        attitude.is_some_and(|(attitude, _)| attitude.centre_offset_en_m(1.0).is_none())
    }

    /// The attitude at a time, from the last two where they tell a rate, else the latest, and the error of its tilt that comes from
    /// its age, degrees. `None` if none is recent.
    ///
    /// Times of arrival tell a rate poorly, so what is extrapolated counts as its own error, beside the change that no rate tells.
    fn extrapolated(&self, time_s: f64) -> Option<(Attitude, f64)> {
        let latest = self.latest_attitude(time_s)?;
        let age_s = time_s - latest.time_s;
        let (before, share) = self
            .previous_attitude
            .map(|before| (before, latest.time_s - before.time_s))
            .filter(|(_, interval_s)| {
                (LEAST_RATE_INTERVAL_S..=Attitude::HOLD_S).contains(interval_s)
            })
            .map_or((latest, 0.0), |(before, interval_s)| {
                (before, (age_s / interval_s).min(MOST_EXTRAPOLATED))
            });
        let ahead_deg = |from_deg: f64, to_deg: f64| share * turn_deg(from_deg, to_deg);
        let pitch_ahead_deg = ahead_deg(before.pitch_deg, latest.pitch_deg);
        let roll_ahead_deg = ahead_deg(before.roll_deg, latest.roll_deg);
        let attitude = Attitude {
            time_s,
            yaw_deg: latest.yaw_deg + ahead_deg(before.yaw_deg, latest.yaw_deg),
            pitch_deg: latest.pitch_deg + pitch_ahead_deg,
            roll_deg: latest.roll_deg + roll_ahead_deg,
        };
        let sigma_deg = (ATTITUDE_SPREAD_DEG_S * age_s)
            .hypot(pitch_ahead_deg)
            .hypot(roll_ahead_deg);
        Some((attitude, sigma_deg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attitude(time_s: f64, roll_deg: f64) -> Input {
        Input::Attitude(Attitude {
            time_s,
            yaw_deg: 90.0,
            pitch_deg: 0.0,
            roll_deg,
        })
    }

    /// The roll and its error at a time after some attitudes, degrees.
    fn seen(attitudes: &[(f64, f64)], time_s: f64) -> (f64, f64) {
        let mut sensors = Sensors::default();
        for (time_s, roll_deg) in attitudes {
            sensors.take(&attitude(*time_s, *roll_deg));
        }
        sensors.take(&Input::Height(Height {
            time_s,
            agl_m: 100.0,
            amsl_m: Some(300.0),
        }));
        match sensors.view(time_s, None, &TrackOptions::default()) {
            View::Attitude {
                attitude,
                sigma_deg,
                ..
            } => (attitude.roll_deg, sigma_deg),
            view => panic!("{view:?}"),
        }
    }

    #[test]
    fn a_roll_goes_on_between_attitudes_and_its_error_says_so() {
        let (roll_deg, sigma_deg) = seen(&[(1.0, 2.0), (1.1, 4.0)], 1.15);
        assert!((roll_deg - 5.0).abs() < 1e-9, "{roll_deg}");
        let expected_deg = (ATTITUDE_SPREAD_DEG_S * 0.05).hypot(1.0);
        assert!((sigma_deg - expected_deg).abs() < 1e-9, "{sigma_deg}");
        assert_eq!(seen(&[(1.0, 2.0), (1.1, 4.0)], 1.1), (4.0, 0.0));
        // Long after the last one no rate holds.
        let (roll_deg, _) = seen(&[(1.0, 2.0), (1.1, 4.0)], 1.5);
        assert!((roll_deg - 8.0).abs() < 1e-9, "{roll_deg}");
    }

    #[test]
    fn attitudes_that_arrive_together_tell_no_rate() {
        for apart_s in [0.0, 2e-5, 0.005] {
            let together = [(0.95, 0.0), (1.0, 0.05), (1.0 + apart_s, -0.05)];
            let (roll_deg, sigma_deg) = seen(&together, 1.02);
            assert_eq!(roll_deg, -0.05, "{apart_s}");
            assert!(sigma_deg < 0.11, "{sigma_deg}");
        }
        // A rate that times of arrival overstate is within what is said of it: 20 degrees a second, stamped 20 ms apart.
        let (roll_deg, sigma_deg) = seen(&[(1.0, 2.0), (1.02, 3.0)], 1.06);
        assert!(
            (roll_deg - 3.8).abs() < 2.0 * sigma_deg,
            "{roll_deg} {sigma_deg}"
        );
    }

    /// What the last of heights ten times a second says, metres.
    fn last_climb(agl_m: impl IntoIterator<Item = f64>) -> Climb {
        let mut sensors = Sensors::default();
        let changes = agl_m.into_iter().enumerate().map(|(number, agl_m)| {
            sensors.take(&Input::Height(Height {
                time_s: 0.1 * number as f64,
                agl_m,
                amsl_m: None,
            }))
        });
        match changes.last().flatten() {
            Some(Change::Climb(climb)) => climb,
            change => panic!("{change:?}"),
        }
    }

    #[test]
    fn a_height_that_is_repeated_until_the_next_one_climbs_with_it() {
        let held = |repeats: usize| [vec![100.0; repeats], vec![110.0]].concat();
        for repeats in [5, 10, 100] {
            let climb = last_climb(held(repeats));
            assert_eq!((climb.factor, climb.reference_step_m), (1.1, None));
        }
        assert_eq!(
            last_climb([99.0, 100.0, 110.0]).reference_step_m,
            Some(10.0)
        );
        let hovered = [vec![100.0; 100], vec![60.0]].concat();
        assert_eq!(last_climb(hovered).reference_step_m, Some(-40.0));
    }

    #[test]
    fn a_height_holds_above_the_ground_and_the_sea_for_the_same_time() {
        let mut sensors = Sensors::default();
        sensors.take(&Input::Height(Height {
            time_s: 1.0,
            agl_m: 100.0,
            amsl_m: Some(300.0),
        }));
        let (holds_s, is_old_s) = (1.0 + Height::HOLD_S, 1.1 + Height::HOLD_S);
        assert_eq!(
            sensors.agl_m(holds_s).zip(sensors.amsl_m(holds_s)),
            Some((100.0, 300.0))
        );
        assert_eq!(
            (sensors.agl_m(is_old_s), sensors.amsl_m(is_old_s)),
            (None, None)
        );
    }
}
