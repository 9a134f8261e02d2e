//! A simulated flight: truth, and what sensors and fixes tell of it and when.

use grimnet_geo::{LonLat, destination_en_m};
use nalgebra::{Matrix2, Rotation2, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{
    errors::{Confidence, Drift, SEPARATION, confidence, normal},
    path::{Camera, STEP_S, Truth, fly},
};
use crate::{
    input::{Attitude, Height, Input, Miss, PositionFix, RelativeMotion, Velocity},
    options::Vehicle,
    tilt::CentreOffset,
};

/// Legs over water, snow or fields, where no frame gives a fix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaps {
    /// Shortest leg, seconds.
    pub shortest_s: f64,
    /// Longest leg, seconds.
    pub longest_s: f64,
    /// Mean time between legs, seconds.
    pub apart_s: f64,
}

/// What is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightOptions {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Seconds.
    pub duration_s: f64,
    /// Frames a second.
    pub frame_rate_hz: f64,
    /// The vehicle.
    pub vehicle: Vehicle,
    /// How the camera is carried.
    pub camera: Camera,
    /// Metres above ground.
    pub height_agl_m: f64,
    /// Share of frames outside of gaps that give a fix.
    pub fix_rate: f64,
    /// Legs without fixes.
    pub gaps: Option<Gaps>,
    /// Share of the fixes that are of another place.
    pub alias_share: f64,
    /// Mean number of frames that a wrong place repeats.
    pub alias_frames: f64,
    /// How confident wrong fixes are.
    pub confidence: Confidence,
    /// Fixes come late by up to this, seconds, each by another time, so that they swap.
    pub latest_s: f64,
    /// Whether attitude and height are told.
    pub attitude: bool,
    /// Whether the autopilot's velocity is told.
    pub velocity: bool,
    /// Whether motion between frames is measured.
    pub motion: bool,
    /// When the aircraft is put elsewhere, seconds.
    pub put_elsewhere_s: Option<f64>,
    /// Offset of the map, metres per axis, 1 sigma.
    pub map_error_m: f64,
    /// Boresight, degrees per axis, 1 sigma.
    pub boresight_deg: f64,
    /// Error of roll and pitch, degrees, 1 sigma.
    pub attitude_sigma_deg: f64,
    /// Error of the velocity per axis, metres per second, 1 sigma.
    pub velocity_sigma_m_s: f64,
    /// Correlation time of the velocity's error, seconds.
    pub velocity_correlation_s: f64,
}

impl Default for FlightOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            duration_s: 600.0,
            frame_rate_hz: 2.0,
            vehicle: Vehicle::Multirotor,
            camera: Camera::Fixed,
            height_agl_m: 120.0,
            fix_rate: 0.9,
            gaps: None,
            alias_share: 0.1,
            alias_frames: 3.0,
            confidence: Confidence::Calibrated,
            latest_s: 0.0,
            attitude: true,
            velocity: true,
            motion: false,
            put_elsewhere_s: None,
            map_error_m: 1.0,
            boresight_deg: 1.0,
            attitude_sigma_deg: 0.5,
            velocity_sigma_m_s: 0.3,
            velocity_correlation_s: 60.0,
        }
    }
}

/// An input and when it arrives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivered {
    /// Seconds.
    pub arrival_s: f64,
    /// The input.
    pub input: Input,
}

/// A simulated flight.
#[derive(Debug, Clone)]
pub struct Flight {
    /// What was simulated.
    pub options: FlightOptions,
    /// Inputs in order of arrival.
    pub deliveries: Vec<Delivered>,
    path: Vec<Truth>,
    origin: LonLat,
}

/// The plane of simulation is around this place.
const ORIGIN: LonLat = LonLat::new(120.72, 24.24);
/// Focal length of the simulated photos, pixels.
const FOCAL_LENGTH_PX: f64 = 2800.0;
/// Attitudes and velocities a second.
const TELEMETRY_HZ: f64 = 10.0;
/// Correlation time of the error of roll and pitch, seconds.
const ATTITUDE_CORRELATION_S: f64 = 2.0;

impl Flight {
    /// Draws a flight.
    pub fn new(options: FlightOptions) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        let mut path = fly(
            options.vehicle,
            options.camera,
            options.duration_s,
            options.height_agl_m,
            &mut rng,
        );
        if let Some(at_s) = options.put_elsewhere_s {
            let angle_rad = rng.random_range(0.0..std::f64::consts::TAU);
            let there_m =
                Rotation2::new(angle_rad) * Vector2::new(rng.random_range(500.0..1500.0), 0.0);
            for truth in path.iter_mut().filter(|truth| truth.time_s >= at_s) {
                truth.position_m += there_m;
            }
        }
        let mut deliveries = telemetry(&options, &path, &mut rng);
        deliveries.extend(frames(&options, &path, &mut rng));
        deliveries.sort_by(|a, b| a.arrival_s.total_cmp(&b.arrival_s));
        Self {
            options,
            deliveries,
            path,
            origin: ORIGIN,
        }
    }

    /// Where the aircraft is, in steps of 1/20 s.
    pub fn truth_at(&self, time_s: f64) -> LonLat {
        let truth = truth_at(&self.path, time_s);
        destination_en_m(self.origin, truth.position_m.x, truth.position_m.y)
    }

    /// Times at which a track is measured: five a second.
    pub fn instants_s(&self) -> impl Iterator<Item = f64> + use<> {
        let count = (self.options.duration_s * 5.0) as u32;
        (1..count).map(|index| f64::from(index) * 0.2)
    }
}

fn truth_at(path: &[Truth], time_s: f64) -> &Truth {
    let index = (time_s / STEP_S).round().max(0.0) as usize;
    &path[index.min(path.len() - 1)]
}

/// Attitude, height and velocity, told at once.
fn telemetry(options: &FlightOptions, path: &[Truth], rng: &mut ChaCha8Rng) -> Vec<Delivered> {
    let mut lean =
        [0, 1].map(|_| Drift::new(options.attitude_sigma_deg, ATTITUDE_CORRELATION_S, rng));
    let mut slip = [0, 1].map(|_| {
        Drift::new(
            options.velocity_sigma_m_s,
            options.velocity_correlation_s,
            rng,
        )
    });
    let compass_deg = 4.0 * normal(rng);
    let height_error = 1.0 + 0.01 * normal(rng);
    let mut told = Vec::new();
    let interval_s = 1.0 / TELEMETRY_HZ;
    for tick in 0..(options.duration_s * TELEMETRY_HZ) as u32 {
        let time_s = f64::from(tick) * interval_s;
        let truth = truth_at(path, time_s);
        let lean_deg = lean.each_mut().map(|error| error.step(interval_s, rng));
        let slip_m_s = slip.each_mut().map(|error| error.step(interval_s, rng));
        let mut tell = |input| {
            told.push(Delivered {
                arrival_s: time_s,
                input,
            })
        };
        if options.attitude {
            tell(Input::Attitude(Attitude {
                time_s,
                yaw_deg: truth.yaw_deg + compass_deg,
                pitch_deg: truth.pitch_deg + lean_deg[0],
                roll_deg: truth.roll_deg + lean_deg[1],
            }));
        }
        if tick % 5 == 0 {
            tell(Input::Height(Height {
                time_s,
                agl_m: truth.height_agl_m * height_error,
                amsl_m: None,
            }));
        }
        if options.velocity && tick % 2 == 0 {
            tell(Input::Velocity(Velocity {
                time_s,
                east_m_s: truth.velocity_m_s.x + slip_m_s[0],
                north_m_s: truth.velocity_m_s.y + slip_m_s[1],
                sigma_m_s: options.velocity_sigma_m_s,
            }));
        }
    }
    told
}

/// Wrong places: which offset, for how many frames, how confident.
struct Alias {
    usual_offset_m: Vector2<f64>,
    offset_m: Vector2<f64>,
    active: bool,
    score: f64,
}

fn offset_m(rng: &mut ChaCha8Rng) -> Vector2<f64> {
    let length_m = 30.0 * 20f64.powf(rng.random::<f64>());
    Rotation2::new(rng.random_range(0.0..std::f64::consts::TAU)) * Vector2::new(length_m, 0.0)
}

impl Alias {
    /// Whether the next fix is of another place: a Markov chain with the asked share and mean length.
    fn next(&mut self, options: &FlightOptions, rng: &mut ChaCha8Rng) -> bool {
        let leave = 1.0 / options.alias_frames;
        let enter = leave * options.alias_share / (1.0 - options.alias_share);
        if self.active {
            self.active = rng.random::<f64>() >= leave;
        } else if rng.random::<f64>() < enter {
            self.active = true;
            self.offset_m = if rng.random::<bool>() {
                self.usual_offset_m
            } else {
                offset_m(rng)
            };
            self.score = normal(rng);
        }
        self.active
    }
}

/// Fixes, misses and motion between frames, told late.
fn frames(options: &FlightOptions, path: &[Truth], rng: &mut ChaCha8Rng) -> Vec<Delivered> {
    let map_m = Vector2::new(normal(rng), normal(rng)) * options.map_error_m;
    let boresight_rad = Vector2::new(normal(rng), normal(rng)) * options.boresight_deg.to_radians();
    let gaps = draw_gaps(options, rng);
    let mut alias = Alias {
        usual_offset_m: offset_m(rng),
        offset_m: Vector2::zeros(),
        active: false,
        score: 0.0,
    };
    let motion_bias = [0, 1].map(|_| 0.05 * normal(rng));
    let interval_s = 1.0 / options.frame_rate_hz;
    let mut told = Vec::new();
    let mut before: Option<&Truth> = None;
    for frame in 0..(options.duration_s * options.frame_rate_hz) as u32 {
        let truth = truth_at(path, f64::from(frame) * interval_s);
        let time_s = truth.time_s;
        let arrival_s = time_s + rng.random::<f64>() * options.latest_s;
        let mut tell = |input| told.push(Delivered { arrival_s, input });
        if let Some(before) = before.filter(|_| options.motion) {
            tell(Input::Motion(motion(before, truth, motion_bias, rng)));
        }
        before = Some(truth);
        let in_gap = gaps
            .iter()
            .any(|(from_s, to_s)| (*from_s..*to_s).contains(&time_s));
        if in_gap || rng.random::<f64>() >= options.fix_rate {
            tell(Input::Miss(Miss { time_s }));
            continue;
        }
        let is_alias = options.alias_share > 0.0 && alias.next(options, rng);
        tell(Input::Fix(fix(
            options,
            truth,
            map_m,
            boresight_rad,
            is_alias.then_some(&alias),
            rng,
        )));
    }
    told
}

fn fix(
    options: &FlightOptions,
    truth: &Truth,
    map_m: Vector2<f64>,
    boresight_rad: Vector2<f64>,
    alias: Option<&Alias>,
    rng: &mut ChaCha8Rng,
) -> PositionFix {
    let attitude = Attitude {
        time_s: truth.time_s,
        yaw_deg: truth.yaw_deg,
        pitch_deg: truth.pitch_deg,
        roll_deg: truth.roll_deg,
    };
    let centre_m = CentreOffset::new(&attitude, boresight_rad, truth.height_agl_m)
        .map_or(Vector2::zeros(), |centre| centre.offset_en_m);
    // Sigma between 0.5 and 2 m, up to twice as large along one direction.
    let sigma_m = 0.5 * 4f64.powf(rng.random::<f64>());
    let turn = Rotation2::new(rng.random_range(0.0..std::f64::consts::PI));
    let root =
        turn.matrix() * Matrix2::new(sigma_m, 0.0, 0.0, sigma_m * rng.random_range(0.5..1.0));
    let covariance = root * root.transpose();
    let mut seen_m =
        truth.position_m + centre_m + map_m + root * Vector2::new(normal(rng), normal(rng));
    let mut score = SEPARATION + normal(rng);
    if let Some(alias) = alias {
        seen_m += alias.offset_m;
        if options.confidence == Confidence::Calibrated {
            // Half of the score is common to all frames of one wrong place.
            score = -SEPARATION + 0.5f64.sqrt() * (alias.score + normal(rng));
        }
    }
    PositionFix {
        time_s: truth.time_s,
        lonlat: destination_en_m(ORIGIN, seen_m.x, seen_m.y),
        covariance_en_m2: [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
        map_error_m: options.map_error_m,
        heading_deg: Some(truth.yaw_deg + normal(rng)),
        gsd_m: truth.height_agl_m / FOCAL_LENGTH_PX * (1.0 + 0.01 * normal(rng)),
        confidence: confidence(score, options.alias_share.max(0.01)),
    }
}

fn motion(before: &Truth, now: &Truth, bias: [f64; 2], rng: &mut ChaCha8Rng) -> RelativeMotion {
    let gsd_m = before.height_agl_m / FOCAL_LENGTH_PX;
    let moved_px = (now.position_m - before.position_m) / gsd_m;
    let (sin, cos) = before.yaw_deg.to_radians().sin_cos();
    let forward_px = moved_px.x * sin + moved_px.y * cos;
    let right_px = moved_px.x * cos - moved_px.y * sin;
    let white_px = Vector2::new(normal(rng), normal(rng));
    RelativeMotion {
        from_time_s: before.time_s,
        time_s: now.time_s,
        forward_px: forward_px * (1.0 + bias[0]) - right_px * bias[1] + white_px.x,
        right_px: right_px * (1.0 + bias[0]) + forward_px * bias[1] + white_px.y,
        turn_deg: now.yaw_deg - before.yaw_deg + 0.5 * normal(rng),
        sigma_px: 1.0,
    }
}

fn draw_gaps(options: &FlightOptions, rng: &mut ChaCha8Rng) -> Vec<(f64, f64)> {
    let Some(gaps) = options.gaps else {
        return Vec::new();
    };
    let mut drawn = Vec::new();
    // The start is over town.
    let mut from_s = 20.0 + rng.random_range(0.0..2.0) * gaps.apart_s;
    while from_s < options.duration_s {
        let length_s = rng.random_range(gaps.shortest_s..=gaps.longest_s);
        drawn.push((from_s, from_s + length_s));
        from_s += length_s + gaps.apart_s * rng.random_range(0.5..1.5);
    }
    drawn
}
