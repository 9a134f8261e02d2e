//! The loop over the frames of a flight.

use std::sync::Arc;
use std::time::Instant;

use grimnet_locate::{FrameFeatures, Localizer, LocateError, Outcome, Prior, Reason};
use grimnet_photo::{Photo, View, focal_px};
use grimnet_track::{
    Attitude, Height, Input, InputError, Miss, OptionsError, Taken, TrackOptions, TrackPoint,
    Tracker,
};

use crate::between_frames::{SearchedFrame, motion_between};
use crate::frame::{FrameAnswer, FrameTimeMs, Known, Searched};
use crate::position_fix::position_fix;
use crate::recent::Recent;
use crate::recorded_attitude::recorded_attitude;
use crate::search_plan::{PlannedSearch, Steering, plan};
use crate::told::{Doubt, Told, ToldOfPhoto};
use crate::whole_map::{WholeMap, map_area_m2};

/// Half the diagonal of a frame's footprint where nothing tells it, metres: 120 m above ground with a field of view of 70 degrees.
const TYPICAL_HALF_FOOTPRINT_M: f64 = 105.0;

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
    told: Told,
    whole_map: WholeMap,
    /// Ground resolution of the last fix, for the reference focal length, metres per pixel.
    last_gsd_m: Option<f64>,
    /// The frame before.
    last_frame: Option<SearchedFrame>,
    /// Times of the latest frames, seconds.
    frame_times_s: Vec<f64>,
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
            told: Told::default(),
            whole_map: WholeMap::default(),
            last_gsd_m: None,
            last_frame: None,
            frame_times_s: Vec::new(),
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

    /// Takes in telemetry: attitude, height, velocity. `None` if it is left out because fixes contradicted it ([`Flight::doubts`]).
    ///
    /// # Errors
    /// As [`Tracker::push`].
    pub fn push(&mut self, input: Input) -> Result<Option<Taken>, InputError> {
        let taken = if self.leaves_out(&input) {
            input.validate()?;
            None
        } else {
            Some(self.tracker.push(input)?)
        };
        self.recent.take(&input);
        self.told.take(&input);
        Ok(taken)
    }

    /// What is wrong with the telemetry, where enough fixes agree on it.
    pub fn doubts(&self) -> impl Iterator<Item = Doubt> {
        self.told.doubts()
    }

    /// Whether the flight goes without telemetry of this kind, because fixes contradicted it.
    pub fn leaves_out(&self, input: &Input) -> bool {
        self.told.leaves_out(input)
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
    pub fn frame(&mut self, photo: &Photo, time_s: f64, known: &Known) -> FrameAnswer {
        let started = Instant::now();
        let is_repeated = self.frame_times_s.contains(&time_s);
        let view = photo.view(&known.prior.view);
        let px_per_reference_px = self.px_per_reference_px(photo, &view);
        let mut given = Given::default();
        if !is_repeated {
            self.give_attitude(time_s, known, &view, &mut given);
        }
        if let Some(agl_m) = known.prior.view.height_agl_m.filter(|_| !is_repeated) {
            let height = Height {
                time_s,
                agl_m,
                amsl_m: None,
            };
            given.push(&mut self.tracker, Input::Height(height));
        }
        let half_footprint_m = self.half_footprint_m(photo, &view, px_per_reference_px);
        let search = self.tracker.search(time_s, half_footprint_m);
        let yaw_deg = self.yaw_deg(time_s, known);
        let height_agl_m = self.recent.height_agl_m_at(time_s);
        let steering = Steering {
            known: known.prior,
            view: &view,
            yaw_deg: yaw_deg.filter(|_| self.told.tells_yaw()),
            tests_yaw: self.told.tests_yaw(self.whole_map.vain_searches()),
            tests_height: self.told.tests_height(self.whole_map.vain_searches()),
            height_agl_m: height_agl_m.filter(|_| !self.told.leaves_out_height()),
            whole_map: self
                .whole_map
                .is_due(search.whole_map, self.whole_map_after_misses),
            px_per_reference_px,
        };
        let steered_to_whole_map = steering.whole_map;
        let searches = plan(&search, &steering);
        let locating = Instant::now();
        let (outcome, features, searched, count) = self.search(photo, &searches);
        let locate_ms = elapsed_ms(locating);
        if !is_repeated {
            let focal_length_px = view
                .hfov_deg
                .map(|hfov_deg| focal_px(f64::from(photo.full_size_px.0), hfov_deg));
            let attitude = known
                .attitude
                .or_else(|| self.recent.attitude_at(time_s))
                .or_else(|| recorded_attitude(&view, time_s));
            if let Ok(Outcome::Fix(fix)) = &outcome {
                let told = ToldOfPhoto {
                    attitude,
                    yaw_deg: yaw_deg.map(|(yaw_deg, _)| yaw_deg),
                    height_agl_m,
                    size_px: photo.full_size_px,
                    focal_length_px,
                };
                let track = self.tracker.point_at(time_s);
                let track = track.filter(|point| point.state.is_usable());
                let track = track.and_then(|point| point.estimate);
                if self.told.fix(time_s, fix, &told, track.as_ref()) {
                    self.tracker.restart();
                    given = Given {
                        after_restart: true,
                        ..Given::default()
                    };
                }
            }
            let seen = outcome.as_ref().ok().and_then(Outcome::fix);
            let heading = seen.and_then(|fix| Some((time_s, fix.heading_deg?)));
            self.told.compare_times(heading, &self.recent);
            if let Some(features) = features {
                let searched = SearchedFrame {
                    time_s,
                    features,
                    attitude: attitude.filter(|_| !self.told.leaves_out_attitude()),
                    focal_length_px,
                    px_per_reference_px,
                };
                self.give_motion(searched, &mut given);
            }
            let whole_map_was_searched =
                steered_to_whole_map || matches!(searched, Searched::WholeMap);
            self.give_outcome(time_s, &outcome, px_per_reference_px, &mut given);
            self.count(time_s, &outcome, whole_map_was_searched);
            if outcome.is_ok() && time_s.is_finite() {
                self.remember_frame(time_s);
            }
        }
        FrameAnswer {
            time_s,
            outcome,
            searched,
            searches: count,
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

    /// Searches one plan after the other until one gives a fix or no other can.
    fn search(
        &self,
        photo: &Photo,
        searches: &[PlannedSearch],
    ) -> (
        Result<Outcome, LocateError>,
        Option<FrameFeatures>,
        Searched,
        u32,
    ) {
        let mut count = 0;
        let mut last = None;
        let mut first_features = None;
        for planned in searches {
            count += 1;
            let (outcome, features) = self.locate(photo, &planned.prior);
            // Those of the fix, else of the first search, whose heading is the most probable.
            if matches!(outcome, Ok(Outcome::Fix(_))) || first_features.is_none() {
                first_features = features;
            }
            let ends = match &outcome {
                Ok(Outcome::Fix(_)) | Err(_) => true,
                Ok(Outcome::NoFix(no_fix)) => is_without_texture(&no_fix.reason),
            };
            last = Some((outcome, planned.searched));
            if ends {
                break;
            }
        }
        // A plan has one search at least.
        let (outcome, searched) = last.unwrap_or_else(|| {
            let (outcome, features) = self.locate(photo, &Prior::none());
            first_features = features;
            (outcome, Searched::WholeMap)
        });
        (outcome, first_features, searched, count)
    }

    fn locate(
        &self,
        photo: &Photo,
        prior: &Prior,
    ) -> (Result<Outcome, LocateError>, Option<FrameFeatures>) {
        match self.localizer.locate_with_features(photo, prior) {
            Ok((outcome, features)) => (Ok(outcome), features),
            Err(error) => (Err(error), None),
        }
    }

    /// Gives the filter the motion from the frame before, and keeps this one.
    fn give_motion(&mut self, mut frame: SearchedFrame, given: &mut Given) {
        let options = self.tracker.options();
        let motion = self.last_frame.as_ref().and_then(|last| {
            // Keypoints of one localiser are always comparable.
            motion_between(&self.localizer, last, &mut frame, options)
                .ok()
                .flatten()
        });
        if let Some(motion) = motion {
            given.push(&mut self.tracker, Input::Motion(motion));
        }
        self.last_frame = Some(frame);
    }

    fn give_outcome(
        &mut self,
        time_s: f64,
        outcome: &Result<Outcome, LocateError>,
        px_per_reference_px: f64,
        given: &mut Given,
    ) {
        match outcome {
            Ok(Outcome::Fix(fix)) => {
                let mut measured = position_fix(fix, time_s, self.localizer.options().map_error_m);
                measured.gsd_m *= px_per_reference_px;
                given.push(&mut self.tracker, Input::Fix(measured));
                self.last_gsd_m = Some(measured.gsd_m);
            }
            Ok(Outcome::NoFix(no_fix)) if !is_without_texture(&no_fix.reason) => {
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
                if estimate.is_some_and(|estimate| estimate.age_of_last_fix_s == Some(0.0)) {
                    self.whole_map.accepted();
                    if point.is_some_and(|point| point.state.is_usable()) {
                        self.told.believed();
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
            }
            Ok(Outcome::NoFix(_)) | Err(_) => {}
        }
    }

    /// Remembers the time of a frame for as long as the filter takes late ones.
    fn remember_frame(&mut self, time_s: f64) {
        let lag_s = self.tracker.options().lag_s;
        self.frame_times_s
            .retain(|other_s| (other_s - time_s).abs() <= lag_s);
        self.frame_times_s.push(time_s);
    }

    /// The fix of the last frame contradicts a track that is believed: it does not tell which of its keypoints lie on the ground.
    fn distrust_last_fix(&mut self) {
        if let Some(last) = &mut self.last_frame {
            last.features.distrust_fix();
        }
    }

    /// Gives the filter the attitude that the caller knows, else that of the metadata where telemetry told none.
    fn give_attitude(&mut self, time_s: f64, known: &Known, view: &View, given: &mut Given) {
        if self.told.leaves_out_attitude() {
            return;
        }
        let attitude = match known.attitude {
            Some(attitude) => Some(Attitude { time_s, ..attitude }),
            None if self.recent.attitude_at(time_s).is_some() => None,
            None => recorded_attitude(view, time_s),
        };
        if let Some(attitude) = attitude {
            given.push(&mut self.tracker, Input::Attitude(attitude));
        }
    }

    /// Yaw that was measured at this time, and its 1-sigma, degrees.
    fn yaw_deg(&self, time_s: f64, known: &Known) -> Option<(f64, f64)> {
        let attitude = known.attitude.or_else(|| self.recent.attitude_at(time_s))?;
        Some((attitude.yaw_deg, self.tracker.options().compass_sigma_deg))
    }

    /// Pixels of this photo for one pixel at the focal length that the track's ground resolutions refer to: that of the options
    /// or of the first photo that tells one. It changes where the camera zooms.
    fn px_per_reference_px(&mut self, photo: &Photo, view: &View) -> f64 {
        let Some(hfov_deg) = view.hfov_deg else {
            return 1.0;
        };
        let focal_px = focal_px(f64::from(photo.full_size_px.0), hfov_deg);
        match self.tracker.options().focal_length_px {
            Some(reference_px) => focal_px / reference_px,
            None => {
                // Refused after the first fix: the photos before had an unknown focal length, so all are taken for equal.
                self.tracker.set_focal_length_px(focal_px);
                1.0
            }
        }
    }

    fn half_footprint_m(&self, photo: &Photo, view: &View, px_per_reference_px: f64) -> f64 {
        let (width_px, height_px) = photo.full_size_px;
        let of_track_m = self.last_gsd_m.map(|gsd_m| gsd_m / px_per_reference_px);
        let gsd_m = of_track_m.or_else(|| Some(view.footprint?.gsd_m(width_px)));
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
    refused: Vec<InputError>,
}

impl Given {
    fn push(&mut self, tracker: &mut Tracker, input: Input) {
        self.inputs.push(input);
        if let Err(error) = tracker.push(input) {
            self.refused.push(error);
        }
    }
}

/// Whether there is nothing in the photo that could be found anywhere.
fn is_without_texture(reason: &Reason) -> bool {
    matches!(reason, Reason::TooFewKeypoints { .. })
}

fn elapsed_ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
