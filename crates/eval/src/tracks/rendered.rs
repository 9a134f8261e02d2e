//! A flight over a procedural town in pixels: each frame is rendered, searched where the filter says, and measured against the one
//! before.

use std::sync::Arc;

use grimnet_flight::{Known, Searched, position_fix};
use grimnet_geo::{LonLat, destination_en_m, offset_en_m, turn_deg};
use grimnet_locate::{Fix, Localizer, LocateError, Prior};
use grimnet_photo::{Metadata, Photo};
use grimnet_track::simulation::{Delivered, FixSample, Flight, FlightOptions, TruePose};
use grimnet_track::{Input, OptionsError, RelativeMotion, TrackOptions};
use grimnet_world::{Camera, Look, Pose, Season, View, WorldError};
use image::RgbImage;
use nalgebra::{Rotation3, Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

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
    /// What its frames gave.
    pub flown: FlownFrames,
}

/// What the frames of a flight gave. The rest follows from the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlownFrames {
    /// Fixes, misses and motions as the filter was given them, in order of the frames.
    pub inputs: Vec<Delivered>,
    /// Each frame compared with the truth.
    pub frames: Vec<FrameRecord>,
    /// The filter's options as they were used, with the map's area.
    pub options: TrackOptions,
}

/// Errors of the aircraft's installation and of the map, one draw a flight.
struct Constants {
    boresight_rad: Vector2<f64>,
    map_offset_en_m: [f64; 2],
}

/// A rendered frame.
struct Frame {
    photo: Photo,
    pose: TruePose,
    /// True image centre, as it is on the map.
    centre: LonLat,
}

impl RenderedPlan {
    /// Flies, renders and searches. `options` are the filter's; `done` is called after each frame.
    ///
    /// # Errors
    /// [`RenderedError`].
    pub fn fly(
        &self,
        town: &Town,
        localizer: &Arc<Localizer>,
        options: &TrackOptions,
        done: &mut dyn FnMut(),
    ) -> Result<FlownFrames, RenderedError> {
        let flight = Flight::without_frames(self.flight.clone());
        let (constants, mut rng) = self.constants();
        let follow_options = grimnet_flight::FlightOptions {
            track: options.clone(),
            ..grimnet_flight::FlightOptions::default()
        };
        let mut follow = grimnet_flight::Flight::new(localizer.clone(), follow_options)?;
        let known = Known {
            prior: Prior::none().with_hfov_deg(CAMERA.hfov_deg),
            ..Known::default()
        };
        let telemetry = flight.deliveries.clone();
        let mut telemetry = telemetry.iter().peekable();
        let (mut inputs, mut frames) = (Vec::new(), Vec::new());
        let mut before: Option<TruePose> = None;
        let interval_s = 1.0 / self.flight.frame_rate_hz;
        for index in 0..self.frame_count() {
            let time_s = index as f64 * interval_s;
            while let Some(delivered) = telemetry.next_if(|d| d.arrival_s <= time_s) {
                // What is refused is counted by the filter.
                let _ = follow.push(delivered.input);
            }
            let leg = self
                .legs
                .iter()
                .find(|leg| (leg.from_s..leg.to_s).contains(&time_s));
            let frame = self.render(town, &flight, &constants, time_s, leg)?;
            let answer = follow.frame(&frame.photo, time_s, &known);
            let outcome = answer.outcome?;
            let motion = answer.inputs.iter().find_map(|input| match input {
                Input::Motion(motion) => Some(*motion),
                _ => None,
            });
            frames.push(FrameRecord {
                time_s,
                cover: leg.map(|leg| leg.cover),
                tracked: matches!(answer.searched, Searched::Window { .. }),
                fix: outcome.fix().map(|fix| measured(fix, &frame, localizer)),
                motion: motion
                    .zip(before)
                    .map(|(motion, before)| measured_motion(&motion, &before, &frame.pose)),
                time_ms: answer.time_ms.total,
            });
            let arrival_s = time_s + rng.random::<f64>() * self.flight.latest_s;
            let delivered = |input| Delivered { arrival_s, input };
            inputs.extend(answer.inputs.into_iter().map(delivered));
            before = Some(frame.pose);
            done();
        }
        Ok(FlownFrames {
            inputs,
            frames,
            options: follow.tracker().options().clone(),
        })
    }

    /// The flight with what its frames gave.
    #[must_use]
    pub fn flown(self, mut flown: FlownFrames) -> RenderedFlight {
        let constants = self.constants().0;
        let mut flight = Flight::without_frames(self.flight);
        for frame in &mut flown.frames {
            if let Some(fix) = &mut frame.fix {
                let pose = flight.pose_at(frame.time_s);
                fix.relief_en_m = relief_en_m(&pose, constants.boresight_rad, fix.sample.gsd_ratio);
            }
        }
        flight.deliver(flown.inputs.iter().copied());
        RenderedFlight {
            name: self.name,
            flight,
            legs: self.legs,
            flown,
        }
    }

    /// What is drawn for the flight, and the random numbers that come after.
    fn constants(&self) -> (Constants, ChaCha8Rng) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.flight.seed ^ 0x5eed);
        (Constants::draw(&self.flight, &mut rng), rng)
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
        Ok(Frame {
            // A frame of a video states nothing of itself.
            photo: Photo::from_image(image, Metadata::default()),
            pose,
            centre: town.lonlat(centre_m)?,
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

fn measured(fix: &Fix, frame: &Frame, localizer: &Localizer) -> MeasuredFix {
    let stated = position_fix(fix, 0.0, localizer.options().map_error_m);
    let found = LonLat::new(fix.lon_deg, fix.lat_deg);
    let (east_m, north_m) = offset_en_m(frame.centre, found);
    let true_top_deg = frame.pose.attitude.top_deg();
    let heading_error_deg = fix
        .heading_deg
        .map_or(0.0, |top_deg| turn_deg(true_top_deg, top_deg));
    let cos = frame.pose.attitude.pitch_deg.to_radians().cos()
        * frame.pose.attitude.roll_deg.to_radians().cos();
    let true_gsd_m = frame.pose.height_agl_m / CAMERA.focal_px() * cos.powf(-1.5);
    MeasuredFix {
        sample: FixSample {
            error_en_m: [east_m, north_m],
            covariance_en_m2: stated.covariance_en_m2,
            confidence: stated.confidence,
            heading_error_deg,
            gsd_ratio: fix.gsd_m / true_gsd_m,
        },
        error_m: east_m.hypot(north_m),
        relief_en_m: [0.0; 2],
    }
}

/// By how much a view over a surface that is nearer than the ground by `gsd_ratio` meets it closer to the aircraft, metres east and
/// north.
fn relief_en_m(pose: &TruePose, boresight_rad: Vector2<f64>, gsd_ratio: f64) -> [f64; 2] {
    let attitude = Rotation3::from_euler_angles(
        pose.attitude.roll_deg.to_radians(),
        pose.attitude.pitch_deg.to_radians(),
        pose.attitude.yaw_deg.to_radians(),
    );
    let axis_ned = attitude * Vector3::new(boresight_rad.x, boresight_rad.y, 1.0);
    let factor = (gsd_ratio - 1.0) * pose.height_agl_m / axis_ned.z;
    [axis_ned.y * factor, axis_ned.x * factor]
}

fn measured_motion(motion: &RelativeMotion, before: &TruePose, now: &TruePose) -> MeasuredMotion {
    let (east_m, north_m) = offset_en_m(before.lonlat, now.lonlat);
    let (sin, cos) = before.attitude.yaw_deg.to_radians().sin_cos();
    let gsd_m = before.height_agl_m / CAMERA.focal_px();
    let forward_m = motion.forward_px * gsd_m - (east_m * sin + north_m * cos);
    let right_m = motion.right_px * gsd_m - (east_m * cos - north_m * sin);
    let turned_deg = now.attitude.yaw_deg - before.attitude.yaw_deg;
    MeasuredMotion {
        distance_m: east_m.hypot(north_m),
        error_m: forward_m.hypot(right_m),
        sigma_m: motion.sigma_px * gsd_m,
        turn_error_deg: turn_deg(turned_deg, motion.turn_deg),
    }
}
