//! The loop over the frames of a flight.

use std::sync::Arc;
use std::time::Instant;

use grimnet_locate::{Localizer, LocateError, Outcome};
use grimnet_photo::{PITCH_RANGE_DEG, Photo, View};
use grimnet_track::{
    Attitude, Height, Input, InputError, Miss, OptionsError, Taken, TrackOptions, TrackPoint,
    Tracker,
};

use crate::between_frames::{SearchedFrame, motion_between};
use crate::consistency::{ConsistencyChecks, PhotoTelemetry};
use crate::exposure::{Exposure, focal_length_px};
use crate::frame::{FrameAnswer, FrameTimeMs, Known};
use crate::frame_history::FrameHistory;
use crate::frame_search::{Found, is_without_texture, search_frame};
use crate::left_out::LeftOut;
use crate::position_fix::position_fix;
use crate::recent::Recent;
use crate::recorded_attitude::recorded_attitude;
use crate::search_plan::{Steering, plan};
use crate::warning::{ClockWarning, Warning};
use crate::whole_map::{WholeMap, map_area_m2};

/// Half the diagonal of a frame's footprint where nothing tells it, metres: 120 m above ground with a field of view of 70 degrees.
const TYPICAL_HALF_FOOTPRINT_M: f64 = 105.0;

/// Photos that are tilted by less are matched as they are, degrees: nothing is lost there, and an attitude has errors of its own.
const LEVELLED_FROM_DEG: f64 = 15.0;

/// Options of a [`Flight`].
#[derive(Debug, Clone, PartialEq)]
pub struct FlightOptions {
    /// Options of the filter. [`TrackOptions::search_area_m2`] is replaced by the map's area, and
    /// [`TrackOptions::focal_length_px`], where it is `None`, by that of the first photo that tells it.
    pub track: TrackOptions,
    /// After so many frames in a row without a fix that the track accepts, the whole map is searched too: the aircraft may be
    /// somewhere else.
    pub whole_map_after_misses: u32,
}

impl Default for FlightOptions {
    fn default() -> Self {
        Self {
            track: TrackOptions::default(),
            whole_map_after_misses: 2,
        }
    }
}

/// Follows one aircraft over the map of a localiser. See the crate's documentation.
#[derive(Debug)]
pub struct Flight {
    localizer: Arc<Localizer>,
    tracker: Tracker,
    whole_map_after_misses: u32,
    recent: Recent,
    checks: ConsistencyChecks,
    whole_map: WholeMap,
    /// Ground resolution of the last fix, for the reference focal length, metres per pixel.
    last_gsd_m: Option<f64>,
    /// The frame before.
    last_frame: Option<SearchedFrame>,
    frames: FrameHistory,
    /// By how much a clock was set the last time, seconds.
    clock_step_s: Option<f64>,
}

impl Flight {
    /// A flight before its first frame. Several flights may share one localiser.
    ///
    /// # Errors
    /// [`OptionsError`] if an option of the filter is not finite or out of range.
    pub fn new(
        localizer: impl Into<Arc<Localizer>>,
        options: FlightOptions,
    ) -> Result<Self, OptionsError> {
        let localizer = localizer.into();
        let search_area_m2 = map_area_m2(&localizer).unwrap_or(options.track.search_area_m2);
        Ok(Self {
            tracker: Tracker::new(TrackOptions {
                search_area_m2,
                ..options.track
            })?,
            localizer,
            whole_map_after_misses: options.whole_map_after_misses,
            recent: Recent::default(),
            checks: ConsistencyChecks::default(),
            whole_map: WholeMap::default(),
            last_gsd_m: None,
            last_frame: None,
            frames: FrameHistory::default(),
            clock_step_s: None,
        })
    }

    /// The localiser.
    pub fn localizer(&self) -> &Localizer {
        &self.localizer
    }

    /// The filter: its options as they are used, and its counts.
    pub fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// Takes in telemetry: attitude, height, velocity. `None` if it is left out because fixes contradicted it ([`Flight::warnings`]).
    ///
    /// # Errors
    /// As [`Tracker::push`].
    pub fn push(&mut self, input: Input) -> Result<Option<Taken>, InputError> {
        let taken = if self.left_out_now().contains(&input) {
            input.validate()?;
            None
        } else {
            Some(self.tracker.push(input)?)
        };
        if taken == Some(Taken::Restarted) {
            self.restart_clock();
        }
        self.recent.take(&input);
        self.checks.take(&input);
        Ok(taken)
    }

    /// What is wrong with the times of the inputs and with the telemetry, where enough of them agree on it.
    pub fn warnings(&self) -> impl Iterator<Item = Warning> {
        let clock = self
            .clock_step_s
            .map(|by_s| Warning::Clock(ClockWarning { by_s }));
        clock.into_iter().chain(self.checks.warnings())
    }

    /// The telemetry that the flight goes without now, because fixes contradict it. Whoever carries its track on between frames leaves
    /// it out as well.
    pub fn left_out_now(&self) -> LeftOut {
        self.checks.left_out_now()
    }

    /// The telemetry that the flight went without at any time. Whoever uses all inputs of the flight afterwards leaves it out: some of
    /// it came before fixes contradicted it.
    pub fn left_out(&self) -> LeftOut {
        self.checks.left_out()
    }

    /// The track at a time; see [`Tracker::point_at`].
    pub fn point_at(&self, time_s: f64) -> Option<TrackPoint> {
        self.tracker.point_at(time_s)
    }

    /// Takes in a frame that was exposed at `time_s`: searches it where the track says, and gives its fix to the filter.
    ///
    /// A frame that cannot be used is said in the answer; the flight goes on. A frame without keypoints says nothing of where it was
    /// searched, so it is no [`Miss`] for the filter.
    ///
    /// A frame of the same time as an earlier one is the same exposure, such as when a client sends it again because the answer was
    /// lost. It is searched and answered, but it is no more evidence: the filter is given nothing of it. An earlier one that could not be
    /// used does not count.
    ///
    /// Where the times of several frames in a row go back among those of earlier ones, the camera's clock was set: the track begins
    /// again at the new time ([`Warning::Clock`]).
    pub fn frame(&mut self, photo: &Photo, time_s: f64, known: &Known) -> FrameAnswer {
        let started = Instant::now();
        let view = photo.view(&known.prior.view);
        let exposure = Exposure {
            photo,
            time_s,
            known,
            view: &view,
            px_per_reference_px: self.px_per_reference_px(photo, &view),
        };
        let arrival = self.frames.arrive(photo, time_s);
        let mut given = Given::default();
        if let Some(by_s) = arrival.clock_step_s {
            self.tracker.restart();
            given.after_restart = true;
            self.restart_clock();
            self.clock_step_s = Some(by_s);
        }
        if !arrival.is_repeated {
            self.give_telemetry(&exposure, &mut given);
        }
        let locating = Instant::now();
        let mut found = self.locate_levelled(&exposure);
        let locate_ms = elapsed_ms(locating);
        if !arrival.is_repeated {
            self.take_in(&exposure, &mut found, arrival.is_new_picture, &mut given);
        }
        FrameAnswer {
            time_s,
            outcome: found.outcome,
            searched: found.searched,
            searches: found.searches,
            inputs: given.inputs,
            after_restart: given.after_restart,
            refused: given.refused,
            point: self.tracker.point_at(time_s),
            time_ms: FrameTimeMs {
                locate: locate_ms,
                total: elapsed_ms(started),
            },
        }
    }

    /// Searches a frame, rectified by the attitude of the camera if that is tilted by so much that it would not be found as it is. An attitude
    /// may be wrong: without a fix the frame is searched as it is.
    fn locate_levelled(&self, exposure: &Exposure<'_>) -> Found {
        let Some(known) = self.levelled(exposure) else {
            return self.locate(exposure);
        };
        let levelled = self.locate(&Exposure {
            known: &known,
            view: &exposure.photo.view(&known.prior.view),
            ..*exposure
        });
        if !matches!(&levelled.outcome, Ok(Outcome::NoFix(no_fix)) if !is_without_texture(&no_fix.reason))
        {
            return levelled;
        }
        let as_it_is = self.locate(exposure);
        let searches = levelled.searches + as_it_is.searches;
        let is_found = matches!(as_it_is.outcome, Ok(Outcome::Fix(_)));
        Found {
            searches,
            ..if is_found { as_it_is } else { levelled }
        }
    }

    /// What is known of a photo with the camera's tilt from its attitude, if that is large and neither the caller nor the metadata tell it.
    fn levelled(&self, exposure: &Exposure<'_>) -> Option<Known> {
        let mut known = *exposure.known;
        let attitude = exposure.attitude(&self.recent)?;
        let can_be_rectified = exposure.view.attitude.is_none() && exposure.view.hfov_deg.is_some();
        if !can_be_rectified || self.checks.leaves_out_attitude() {
            return None;
        }
        let [_, pitch_deg, roll_deg] = attitude.to_gimbal_deg();
        let is_tilted = pitch_deg + 90.0 >= LEVELLED_FROM_DEG;
        let view = &mut known.prior.view;
        (view.pitch_deg, view.roll_deg) = (Some(pitch_deg), Some(roll_deg));
        (is_tilted && PITCH_RANGE_DEG.contains(&pitch_deg)).then_some(known)
    }

    /// Bearing of the photo's top on the ground by the telemetry, degrees: the yaw alone where its tilt is not believed.
    fn reported_top_deg(&self, exposure: &Exposure<'_>) -> Option<f64> {
        let attitude = exposure.measured_attitude(&self.recent)?;
        Some(if self.checks.leaves_out_attitude() {
            attitude.yaw_deg
        } else {
            attitude.top_deg()
        })
    }

    /// Searches a frame where track and telemetry say.
    fn locate(&self, exposure: &Exposure<'_>) -> Found {
        let search = self
            .tracker
            .search(exposure.time_s, self.half_footprint_m(exposure));
        let searches_without_fix = self.whole_map.searches_without_fix();
        let top_deg = self
            .reported_top_deg(exposure)
            .filter(|_| self.checks.uses_yaw());
        let height_agl_m = self.recent.height_agl_m_at(exposure.time_s);
        let height_agl_m = height_agl_m.filter(|_| !self.checks.leaves_out_height());
        let steering = Steering {
            known: exposure.known.prior,
            view: exposure.view,
            top_deg: top_deg.map(|top_deg| (top_deg, self.tracker.options().compass_sigma_deg)),
            yaw_is_in_doubt: self.checks.yaw_is_in_doubt(),
            tests_yaw: self.checks.tests_yaw(searches_without_fix),
            tests_height: self.checks.tests_height(searches_without_fix),
            height_agl_m,
            gsd_of_height_m: height_agl_m
                .zip(exposure.focal_length_px())
                .map(|(height_agl_m, focal_px)| height_agl_m / focal_px),
            whole_map: self
                .whole_map
                .is_due(search.whole_map, self.whole_map_after_misses),
            px_per_reference_px: exposure.px_per_reference_px,
        };
        let searches = plan(&search, &steering);
        search_frame(
            &self.localizer,
            exposure.photo,
            &searches,
            steering.whole_map,
        )
    }

    /// Compares a frame that is not repeated with the telemetry, and gives the filter what was found.
    fn take_in(
        &mut self,
        exposure: &Exposure<'_>,
        found: &mut Found,
        is_new_picture: bool,
        given: &mut Given,
    ) {
        let time_s = exposure.time_s;
        let focal_length_px = exposure.focal_length_px();
        let attitude = exposure.attitude(&self.recent);
        if let Ok(Outcome::Fix(fix)) = &found.outcome {
            let telemetry = PhotoTelemetry {
                attitude,
                top_deg: self.reported_top_deg(exposure),
                height_agl_m: self.recent.height_agl_m_at(time_s),
                size_px: exposure.photo.full_size_px,
                focal_length_px,
            };
            let track = self.tracker.point_at(time_s);
            let track = track.filter(|point| point.state.is_usable());
            let track = track.and_then(|point| point.estimate);
            if self.checks.fix(time_s, fix, &telemetry, track.as_ref()) {
                self.tracker.restart();
                *given = Given {
                    after_restart: true,
                    clock_was_set: given.clock_was_set,
                    ..Given::default()
                };
            }
        }
        let fix = found.outcome.as_ref().ok().and_then(Outcome::fix);
        let heading = fix.and_then(|fix| Some((time_s, fix.heading_deg?)));
        self.checks.compare_times(heading, &self.recent);
        let uses_attitude = !self.checks.leaves_out_attitude();
        // Of a camera of which the pitch alone is known the fix tells the rest. A motion is levelled by the pitch alone.
        if attitude.is_none()
            && uses_attitude
            && let Some((_, top_deg)) = heading
            && let Some(attitude) = exposure.attitude_towards(top_deg)
        {
            given.push(&mut self.tracker, Input::Attitude(attitude));
        }
        if let Some(features) = found.features.take() {
            let searched = SearchedFrame {
                time_s,
                features,
                attitude: attitude
                    .or_else(|| exposure.attitude_towards(0.0))
                    .filter(|_| uses_attitude),
                focal_length_px,
                px_per_reference_px: exposure.px_per_reference_px,
            };
            self.give_motion(searched, is_new_picture, given);
        }
        self.give_outcome(exposure, &found.outcome, given);
        if given.clock_was_set {
            self.restart_clock();
        }
        self.count(time_s, &found.outcome, found.whole_map_was_searched);
        if found.outcome.is_ok() {
            self.frames.remember(time_s);
        }
    }

    /// Forgets the times of what came so far: the filter began again, because a clock was set.
    fn restart_clock(&mut self) {
        self.clock_step_s = self.tracker.clock_step_s();
        self.recent = Recent::default();
        self.checks.restart_clock();
        self.frames.restart();
    }

    /// Gives the filter the motion from the frame before, and keeps this one.
    fn give_motion(&mut self, mut frame: SearchedFrame, is_new_picture: bool, given: &mut Given) {
        let options = self.tracker.options();
        let motion = self.last_frame.as_ref().and_then(|last| {
            // Keypoints of one localiser are always comparable.
            motion_between(&self.localizer, last, &mut frame, options)
                .ok()
                .flatten()
        });
        if let Some(motion) = motion {
            if let Some(gsd_m) = self.last_gsd_m {
                self.checks.motion(&motion, gsd_m, is_new_picture);
            }
            given.push(&mut self.tracker, Input::Motion(motion));
        }
        self.last_frame = Some(frame);
    }

    fn give_outcome(
        &mut self,
        exposure: &Exposure<'_>,
        outcome: &Result<Outcome, LocateError>,
        given: &mut Given,
    ) {
        let time_s = exposure.time_s;
        match outcome {
            Ok(Outcome::Fix(fix)) => {
                let mut measured = position_fix(fix, time_s, self.localizer.options().map_error_m);
                measured.gsd_m *= exposure.px_per_reference_px;
                given.push(&mut self.tracker, Input::Fix(measured));
                self.last_gsd_m = Some(measured.gsd_m);
            }
            // Without keypoints it tells when the flight began, if it is the first frame.
            Ok(Outcome::NoFix(no_fix))
                if !is_without_texture(&no_fix.reason) || self.tracker.awaits_start() =>
            {
                given.push(&mut self.tracker, Input::Miss(Miss { time_s }));
            }
            Ok(Outcome::NoFix(_)) | Err(_) => {}
        }
    }

    /// Counts a frame with keypoints as one that the track accepted or did not.
    fn count(
        &mut self,
        time_s: f64,
        outcome: &Result<Outcome, LocateError>,
        whole_map_was_searched: bool,
    ) {
        match outcome {
            Ok(Outcome::Fix(_)) => {
                let point = self.tracker.point_at(time_s);
                let estimate = point.as_ref().and_then(|point| point.estimate);
                if estimate.is_some_and(|estimate| estimate.is_at_fix()) {
                    self.whole_map.accepted();
                    if point.is_some_and(|point| point.state.is_usable()) {
                        self.checks.accepted();
                    }
                } else {
                    self.whole_map.missed(whole_map_was_searched, true);
                    if point.is_some_and(|point| point.state.is_usable()) {
                        self.distrust_last_fix();
                    }
                }
            }
            Ok(Outcome::NoFix(no_fix)) if !is_without_texture(&no_fix.reason) => {
                self.whole_map.missed(whole_map_was_searched, false);
                self.checks
                    .searched_without_fix(self.whole_map.searches_without_fix());
            }
            Ok(Outcome::NoFix(_)) | Err(_) => {}
        }
    }

    /// The fix of the last frame contradicts a track that is believed: it does not tell which of its keypoints lie on the ground.
    fn distrust_last_fix(&mut self) {
        if let Some(last) = &mut self.last_frame {
            last.features.distrust_fix();
        }
    }

    /// Gives the filter the attitude that the caller knows, else that of the metadata where telemetry reported none; and the height that
    /// the caller knows.
    fn give_telemetry(&mut self, exposure: &Exposure<'_>, given: &mut Given) {
        let time_s = exposure.time_s;
        let attitude = match exposure.known.attitude {
            Some(attitude) => Some(Attitude { time_s, ..attitude }),
            None if self.recent.attitude_at(time_s).is_some() => None,
            None => recorded_attitude(exposure.view, time_s),
        };
        if let Some(attitude) = attitude.filter(|_| !self.checks.leaves_out_attitude()) {
            given.push(&mut self.tracker, Input::Attitude(attitude));
        }
        if let Some(agl_m) = exposure.known.prior.view.height_agl_m {
            let height = Height {
                time_s,
                agl_m,
                amsl_m: None,
            };
            given.push(&mut self.tracker, Input::Height(height));
        }
    }

    /// Pixels of this photo for one pixel at the focal length that the track's ground resolutions refer to: that of the options
    /// or of the first photo that tells one. It changes where the camera zooms.
    fn px_per_reference_px(&mut self, photo: &Photo, view: &View) -> f64 {
        let Some(focal_px) = focal_length_px(photo, view) else {
            return 1.0;
        };
        match self.tracker.options().focal_length_px {
            Some(reference_px) => focal_px / reference_px,
            None => {
                // Refused after the first fix: the photos before had an unknown focal length, so all are taken for equal.
                self.tracker.set_focal_length_px(focal_px);
                1.0
            }
        }
    }

    fn half_footprint_m(&self, exposure: &Exposure<'_>) -> f64 {
        let (width_px, height_px) = exposure.photo.full_size_px;
        let of_track_m = self
            .last_gsd_m
            .map(|gsd_m| gsd_m / exposure.px_per_reference_px);
        let gsd_m = of_track_m.or_else(|| Some(exposure.view.footprint?.gsd_m(width_px)));
        gsd_m.map_or(TYPICAL_HALF_FOOTPRINT_M, |gsd_m| {
            0.5 * gsd_m * f64::from(width_px).hypot(f64::from(height_px))
        })
    }
}

/// What the filter was given for a frame.
#[derive(Debug, Default)]
struct Given {
    inputs: Vec<Input>,
    after_restart: bool,
    /// Whether one of them confirmed that a clock was set, so that the filter began again by itself.
    clock_was_set: bool,
    refused: Vec<InputError>,
}

impl Given {
    fn push(&mut self, tracker: &mut Tracker, input: Input) {
        self.inputs.push(input);
        match tracker.push(input) {
            Ok(taken) => self.clock_was_set |= taken == Taken::Restarted,
            Err(error) => self.refused.push(error),
        }
    }
}

fn elapsed_ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
