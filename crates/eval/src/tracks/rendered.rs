//! A flight over a procedural town in pixels: each frame is rendered, searched where the filter says, and measured against the one
//! before.

use std::time::Instant as Clock;

use grimnet_geo::{LonLat, destination_en_m, offset_en_m};
use grimnet_locate::{Fix, FrameFeatures, FramePair, Localizer, LocateError, Prior};
use grimnet_photo::Photo;
use grimnet_track::simulation::{Delivered, FixSample, Flight, FlightOptions, TruePose};
use grimnet_track::{
    Attitude, Input, Miss, OptionsError, PositionFix, RelativeMotion, SearchWindow, TrackOptions,
    Tracker,
};
use grimnet_world::{Camera, Look, Pose, Season, View, WorldError};
use image::RgbImage;
use nalgebra::{Rotation3, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::camera_tilt::{GimbalAngles, frame_tilt, tilt_change_sigma_deg};
use super::frame_record::{FrameRecord, MeasuredFix, MeasuredMotion};
use super::ground_cover::{Cover, CoveredLeg, WaterView, under_snow, water};
use super::town::Town;

/// The camera: that of a small drone, with as many pixels as a query needs.
pub const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 800,
    height_px: 600,
};

/// Season of the photos; the map is of summer.
const SEASON: Season = Season::Autumn;
/// A heading from a window has its range as three standard deviations.
const SIGMAS_OF_RANGE: f64 = 3.0;
/// Where no height is told, metres.
const TYPICAL_HEIGHT_M: f64 = 120.0;
/// A compass without calibration, degrees.
const COMPASS_SIGMA_DEG: f64 = 6.0;

/// Why a flight cannot be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderedError {
    /// A place is outside of the world's projection.
    #[error(transparent)]
    World(#[from] WorldError),
    /// A frame cannot be searched.
    #[error(transparent)]
    Locate(#[from] LocateError),
    /// The filter's options.
    #[error(transparent)]
    Options(#[from] OptionsError),
}

/// A flight to be rendered.
#[derive(Debug, Clone)]
pub struct RenderedPlan {
    /// Name, for people.
    pub name: String,
    /// Path, camera, rates and errors. Its gaps, fixes and aliases are not used: the pixels decide.
    pub flight: FlightOptions,
    /// Legs over water and snow.
    pub legs: Vec<CoveredLeg>,
}

/// A flight that was rendered.
#[derive(Debug, Clone)]
pub struct RenderedFlight {
    /// Name, for people.
    pub name: String,
    /// Path, and all inputs in order of arrival.
    pub flight: Flight,
    /// Legs over water and snow.
    pub legs: Vec<CoveredLeg>,
    /// What each frame gave.
    pub frames: Vec<FrameRecord>,
}

/// What was kept of a frame for the motion to the next one.
struct Kept {
    time_s: f64,
    features: FrameFeatures,
    attitude: Option<Attitude>,
    pose: TruePose,
}

/// Errors of the aircraft's installation and of the map, one draw a flight.
struct Constants {
    boresight_rad: Vector2<f64>,
    map_offset_en_m: [f64; 2],
}

/// What was last told of the view; none of it is older than the frame.
#[derive(Clone, Copy, Default)]
struct Told {
    attitude: Option<Attitude>,
    height_agl_m: Option<f64>,
}

/// A rendered frame.
struct Frame {
    photo: Photo,
    attitude: Option<Attitude>,
    /// As told.
    height_agl_m: Option<f64>,
    pose: TruePose,
    /// True image centre, as it is on the map.
    centre: LonLat,
    /// Bearing of the photo's top from the told yaw, degrees.
    top_from_yaw_deg: f64,
}

/// What a search gave.
struct Searched {
    fix: Option<Fix>,
    features: Option<FrameFeatures>,
    tracked: bool,
}

impl RenderedPlan {
    /// Flies, renders and searches. `options` are the filter's; `done` is called after each frame.
    ///
    /// # Errors
    /// [`RenderedError`].
    pub fn fly(
        self,
        town: &Town,
        localizer: &Localizer,
        options: &TrackOptions,
        done: &mut dyn FnMut(),
    ) -> Result<RenderedFlight, RenderedError> {
        let mut flight = Flight::without_frames(self.flight.clone());
        let mut rng = ChaCha8Rng::seed_from_u64(self.flight.seed ^ 0x5eed);
        let constants = Constants::draw(&self.flight, &mut rng);
        let mut tracker = Tracker::new(options.clone())?;
        let mut on_the_way: Vec<Delivered> = flight.deliveries.clone();
        let mut told: Vec<Delivered> = Vec::new();
        let mut frames = Vec::new();
        let mut before: Option<Kept> = None;
        let mut latest = Told::default();
        let interval_s = 1.0 / self.flight.frame_rate_hz;
        for index in 0..(self.flight.duration_s * self.flight.frame_rate_hz) as u32 {
            let time_s = f64::from(index) * interval_s;
            arrive(&mut on_the_way, time_s, &mut tracker, &mut latest);
            let leg = self
                .legs
                .iter()
                .find(|leg| (leg.from_s..leg.to_s).contains(&time_s));
            let frame = self.render(town, &flight, &constants, latest, time_s, leg)?;
            let since = Clock::now();
            let searched = search(localizer, &tracker, &frame, time_s, options)?;
            let motion = match (&before, &searched.features) {
                (Some(before), Some(features)) => {
                    self.motion(localizer, before, features, &frame, time_s, options)?
                }
                _ => None,
            };
            let time_ms = since.elapsed().as_secs_f64() * 1e3;
            frames.push(FrameRecord {
                time_s,
                cover: leg.map(|leg| leg.cover),
                tracked: searched.tracked,
                fix: searched.fix.as_ref().map(|fix| measured(fix, &frame)),
                motion: motion
                    .zip(before.as_ref())
                    .map(|(motion, before)| measured_motion(&motion, before, &frame)),
                time_ms,
            });
            let arrival_s = time_s + rng.random::<f64>() * self.flight.latest_s;
            let mut tell = |input| {
                told.push(Delivered { arrival_s, input });
                on_the_way.push(Delivered { arrival_s, input });
            };
            if let Some(motion) = motion {
                tell(Input::Motion(motion));
            }
            tell(match &searched.fix {
                Some(fix) => Input::Fix(position_fix(fix, &frame, time_s, localizer)),
                None => Input::Miss(Miss { time_s }),
            });
            before = searched.features.map(|features| Kept {
                time_s,
                features,
                attitude: frame.attitude,
                pose: frame.pose,
            });
            done();
        }
        flight.deliver(told);
        Ok(RenderedFlight {
            name: self.name,
            flight,
            legs: self.legs,
            frames,
        })
    }

    /// Number of frames.
    #[must_use]
    pub fn frame_count(&self) -> u64 {
        (self.flight.duration_s * self.flight.frame_rate_hz) as u64
    }

    fn render(
        &self,
        town: &Town,
        flight: &Flight,
        constants: &Constants,
        told: Told,
        time_s: f64,
        leg: Option<&CoveredLeg>,
    ) -> Result<Frame, RenderedError> {
        let pose = flight.pose_at(time_s);
        let [east_m, north_m] = constants.map_offset_en_m;
        // Where the map shows what is below the aircraft.
        let on_map = destination_en_m(pose.lonlat, east_m, north_m);
        let place_m = town.world_m(on_map)?;
        let north_deg = town.placement.grid_north_deg(place_m)?;
        let camera_pose = camera_pose(&pose, place_m, north_deg, constants.boresight_rad);
        let image = self.image(town, &camera_pose, time_s, leg);
        let centre_px = [
            f64::from(CAMERA.width_px) / 2.0,
            f64::from(CAMERA.height_px) / 2.0,
        ];
        let centre_m = View::new(&camera_pose, &CAMERA)
            .plane_from_photo_px(centre_px, 0.0)
            .unwrap_or(place_m);
        let attitude = told.attitude.filter(|told| time_s - told.time_s < 0.5);
        let angles = attitude.as_ref().map(GimbalAngles::of);
        let metadata = angles.map(|angles| angles.metadata()).unwrap_or_default();
        Ok(Frame {
            photo: Photo::from_image(image, metadata),
            attitude,
            height_agl_m: told.height_agl_m,
            pose,
            centre: town.lonlat(centre_m)?,
            top_from_yaw_deg: angles.map_or(0.0, |angles| angles.top_from_yaw_deg),
        })
    }

    fn image(&self, town: &Town, pose: &Pose, time_s: f64, leg: Option<&CoveredLeg>) -> RgbImage {
        let seed = self.flight.seed;
        let seen = || town.world.render_photo(pose, &CAMERA, &Look::drone(SEASON));
        match leg.map(|leg| leg.cover) {
            None => seen(),
            Some(Cover::Snow) => under_snow(&seen(), seed ^ time_s.to_bits()),
            Some(Cover::Water) => {
                let view = WaterView {
                    place_en_m: [pose.x_m, pose.y_m],
                    heading_deg: pose.heading_deg,
                    gsd_m: pose.height_agl_m / CAMERA.focal_px(),
                };
                water((CAMERA.width_px, CAMERA.height_px), &view, time_s, seed)
            }
        }
    }

    fn motion(
        &self,
        localizer: &Localizer,
        before: &Kept,
        features: &FrameFeatures,
        frame: &Frame,
        time_s: f64,
        options: &TrackOptions,
    ) -> Result<Option<RelativeMotion>, RenderedError> {
        let tilts = before
            .attitude
            .zip(frame.attitude)
            .map(|(first, second)| [frame_tilt(&first), frame_tilt(&second)]);
        let (sigma_deg, correlation_s) = match tilts {
            Some(_) => (options.attitude_sigma_deg, options.attitude_correlation_s),
            None => (
                options.unknown_tilt_sigma_deg,
                options.unknown_tilt_correlation_s,
            ),
        };
        let pair = FramePair {
            focal_length_px: CAMERA.focal_px(),
            tilts,
            tilt_change_sigma_deg: tilt_change_sigma_deg(
                sigma_deg,
                correlation_s,
                time_s - before.time_s,
            ),
        };
        let motion = localizer.motion_between(&before.features, features, &pair)?;
        Ok(motion.map(|motion| RelativeMotion {
            from_time_s: before.time_s,
            time_s,
            forward_px: motion.forward_px,
            right_px: motion.right_px,
            turn_deg: motion.turn_deg,
            sigma_px: motion.sigma_px(),
        }))
    }
}

impl Constants {
    fn draw(options: &FlightOptions, rng: &mut ChaCha8Rng) -> Self {
        // The sum of twelve uniform numbers less six is normal enough for one draw.
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        Self {
            boresight_rad: Vector2::new(normal(), normal()) * options.boresight_deg.to_radians(),
            map_offset_en_m: [normal(), normal()].map(|n| n * options.map_error_m),
        }
    }
}

/// Gives the tracker what has arrived by `time_s`.
fn arrive(on_the_way: &mut Vec<Delivered>, time_s: f64, tracker: &mut Tracker, latest: &mut Told) {
    let mut arrived: Vec<Delivered> = Vec::new();
    on_the_way.retain(|delivered| {
        let has_arrived = delivered.arrival_s <= time_s;
        if has_arrived {
            arrived.push(*delivered);
        }
        !has_arrived
    });
    arrived.sort_by(|a, b| a.arrival_s.total_cmp(&b.arrival_s));
    for delivered in arrived {
        match delivered.input {
            Input::Attitude(attitude) => latest.attitude = Some(attitude),
            Input::Height(height) => latest.height_agl_m = Some(height.agl_m),
            _ => {}
        }
        // What is refused is counted by the tracker.
        let _ = tracker.push(delivered.input);
    }
}

/// The camera's pose in the world: the aircraft's attitude with the boresight.
fn camera_pose(
    pose: &TruePose,
    place_m: [f64; 2],
    north_deg: f64,
    boresight_rad: Vector2<f64>,
) -> Pose {
    let attitude = Rotation3::from_euler_angles(
        pose.attitude.roll_deg.to_radians(),
        pose.attitude.pitch_deg.to_radians(),
        pose.attitude.yaw_deg.to_radians(),
    );
    // A view tilted forward by x and to the right by y in the camera's frame.
    let mounted = Rotation3::from_euler_angles(-boresight_rad.y, boresight_rad.x, 0.0);
    let (roll_rad, pitch_rad, yaw_rad) = (attitude * mounted).euler_angles();
    Pose {
        x_m: place_m[0],
        y_m: place_m[1],
        height_agl_m: pose.height_agl_m,
        heading_deg: (yaw_rad.to_degrees() - north_deg).rem_euclid(360.0),
        pitch_off_nadir_deg: pitch_rad.to_degrees(),
        // The world's roll is positive where the view leans to the right.
        roll_deg: -roll_rad.to_degrees(),
    }
}

/// Half the diagonal of the ground that a photo shows, metres.
fn half_footprint_m(height_agl_m: f64) -> f64 {
    let diagonal_px = f64::from(CAMERA.width_px).hypot(f64::from(CAMERA.height_px));
    0.5 * diagonal_px * height_agl_m / CAMERA.focal_px()
}

/// Searches the filter's windows, the likeliest first, then the whole map where the filter wants it.
fn search(
    localizer: &Localizer,
    tracker: &Tracker,
    frame: &Frame,
    time_s: f64,
    options: &TrackOptions,
) -> Result<Searched, RenderedError> {
    let height_agl_m = frame.height_agl_m.unwrap_or(TYPICAL_HEIGHT_M);
    let wanted = tracker
        .newest_s()
        .map(|_| tracker.search(time_s, half_footprint_m(height_agl_m)));
    let mut features = None;
    let mut priors: Vec<(Prior, bool)> = wanted
        .iter()
        .flat_map(|search| &search.windows)
        .map(|window| (window_prior(window, frame, options), true))
        .collect();
    if wanted.is_none_or(|search| search.whole_map || search.windows.is_empty()) {
        let prior = with_height(Prior::none().with_hfov_deg(CAMERA.hfov_deg), frame);
        let prior = match frame.attitude {
            Some(attitude) => {
                prior.with_heading(attitude.yaw_deg + frame.top_from_yaw_deg, COMPASS_SIGMA_DEG)
            }
            None => prior.with_unknown_heading(),
        };
        priors.push((prior, false));
    }
    for (prior, tracked) in priors {
        let (outcome, found) = localizer.locate_with_features(&frame.photo, &prior)?;
        if let grimnet_locate::Outcome::Fix(fix) = outcome {
            return Ok(Searched {
                fix: Some(*fix),
                features: found,
                tracked,
            });
        }
        features = features.or(found);
    }
    Ok(Searched {
        fix: None,
        features,
        tracked: false,
    })
}

fn with_height(prior: Prior, frame: &Frame) -> Prior {
    match frame.height_agl_m {
        Some(height_agl_m) => prior.with_height_agl_m(height_agl_m),
        None => prior,
    }
}

fn window_prior(window: &SearchWindow, frame: &Frame, options: &TrackOptions) -> Prior {
    let prior = Prior::none()
        .with_hfov_deg(CAMERA.hfov_deg)
        .near(window.centre, window.radius_m);
    let prior = match window.gsd_m {
        Some((least_m, most_m)) => prior.with_gsd_m((least_m * most_m).sqrt()),
        None => with_height(prior, frame),
    };
    match (window.heading_deg, frame.attitude) {
        (Some((yaw_deg, side_deg)), _) => {
            prior.with_heading(yaw_deg + frame.top_from_yaw_deg, side_deg / SIGMAS_OF_RANGE)
        }
        (None, Some(attitude)) => prior.with_heading(
            attitude.yaw_deg + frame.top_from_yaw_deg,
            options.compass_sigma_deg,
        ),
        (None, None) => prior.with_unknown_heading(),
    }
}

/// The fix as the filter takes it.
fn position_fix(fix: &Fix, frame: &Frame, time_s: f64, localizer: &Localizer) -> PositionFix {
    let map_error_m = localizer.options().map_error_m;
    PositionFix {
        time_s,
        lonlat: LonLat::new(fix.lon_deg, fix.lat_deg),
        covariance_en_m2: without_map_error(fix, map_error_m),
        map_error_m,
        heading_deg: fix.heading_deg.map(|top| top - frame.top_from_yaw_deg),
        gsd_m: fix.gsd_m,
        confidence: fix.confidence.unwrap_or(0.5),
    }
}

/// The covariance of a fix without the map's own error, which is the same for all fixes.
pub(super) fn without_map_error(fix: &Fix, map_error_m: f64) -> [f64; 3] {
    let [ee, en, nn] = fix.covariance_en_m2;
    // What is left is positive but for rounding.
    let left = |variance: f64| (variance - map_error_m.powi(2)).max(0.01);
    [left(ee), en, left(nn)]
}

fn measured(fix: &Fix, frame: &Frame) -> MeasuredFix {
    let found = LonLat::new(fix.lon_deg, fix.lat_deg);
    let (east_m, north_m) = offset_en_m(frame.centre, found);
    let true_yaw_deg = frame.pose.attitude.yaw_deg;
    let heading_error_deg = fix.heading_deg.map_or(0.0, |top| {
        (top - frame.top_from_yaw_deg - true_yaw_deg + 180.0).rem_euclid(360.0) - 180.0
    });
    let cos = frame.pose.attitude.pitch_deg.to_radians().cos()
        * frame.pose.attitude.roll_deg.to_radians().cos();
    let true_gsd_m = frame.pose.height_agl_m / CAMERA.focal_px() * cos.powf(-1.5);
    MeasuredFix {
        sample: FixSample {
            error_en_m: [east_m, north_m],
            covariance_en_m2: without_map_error(fix, grimnet_locate::DEFAULT_MAP_ERROR_M),
            confidence: fix.confidence.unwrap_or(0.5),
            heading_error_deg,
            gsd_ratio: fix.gsd_m / true_gsd_m,
        },
        error_m: east_m.hypot(north_m),
    }
}

fn measured_motion(motion: &RelativeMotion, before: &Kept, frame: &Frame) -> MeasuredMotion {
    let (east_m, north_m) = offset_en_m(before.pose.lonlat, frame.pose.lonlat);
    let (sin, cos) = before.pose.attitude.yaw_deg.to_radians().sin_cos();
    let gsd_m = before.pose.height_agl_m / CAMERA.focal_px();
    let forward_m = motion.forward_px * gsd_m - (east_m * sin + north_m * cos);
    let right_m = motion.right_px * gsd_m - (east_m * cos - north_m * sin);
    let turn_deg = frame.pose.attitude.yaw_deg - before.pose.attitude.yaw_deg;
    MeasuredMotion {
        distance_m: east_m.hypot(north_m),
        error_m: forward_m.hypot(right_m),
        sigma_m: motion.sigma_px * gsd_m,
        turn_error_deg: (motion.turn_deg - turn_deg + 180.0).rem_euclid(360.0) - 180.0,
    }
}
