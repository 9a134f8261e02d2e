//! What the localiser gives for each frame: a right fix, one of another place, or none.

use grimnet_geo::destination_en_m;
use nalgebra::{Matrix2, Rotation2, Vector2};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::{
    delivered::Delivered,
    errors::{Confidence, SEPARATION, confidence, normal},
    options::{FixSample, FlightOptions},
    path::{Truth, truth_at},
};
use crate::{
    attitude::Attitude,
    input::{Input, Miss, PositionFix, RelativeMotion},
    tilt::{CentreOffset, gsd_over_nadir},
};

/// Confidences are drawn as if at least this share of fixes were wrong.
const LEAST_ALIAS_SHARE: f64 = 0.01;

/// What ground that is followed from frame to frame may move without being noticed, metres per axis, 1 sigma: half of a threshold
/// of 2.5 px at 0.3 m.
const FOLLOWED_SIGMA_M: f64 = 0.4;
/// Speed of waves of 10 m in deep water, metres per second.
const WAVES_M_S: f64 = 4.0;
/// Directions by this angle are never alike.
const GOLDEN_ANGLE_RAD: f64 = 2.399_963;

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

/// Fixes, misses and motion between frames, delivered late.
pub(super) fn frames(
    options: &FlightOptions,
    path: &[Truth],
    telemetry: &[Delivered],
    rng: &mut ChaCha8Rng,
) -> Vec<Delivered> {
    let attitudes: Vec<Attitude> = telemetry
        .iter()
        .filter_map(|delivered| match delivered.input {
            Input::Attitude(attitude) => Some(attitude),
            _ => None,
        })
        .collect();
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
    let mut deliveries = Vec::new();
    let mut before: Option<Seen<'_>> = None;
    let mut ground = Surface::Unknown;
    for frame in 0..(options.duration_s * options.frame_rate_hz) as u32 {
        let truth = truth_at(path, f64::from(frame) * interval_s);
        let time_s = truth.time_s;
        let arrival_s = time_s + rng.random::<f64>() * options.latest_s;
        let mut deliver = |input| deliveries.push(Delivered { arrival_s, input });
        let seen = Seen::new(truth, attitude_at(&attitudes, time_s), boresight_rad);
        let in_gap = gaps
            .iter()
            .position(|(from_s, to_s)| (*from_s..*to_s).contains(&time_s));
        let water = in_gap.filter(|gap| gap.is_multiple_of(2));
        if water.is_some() {
            ground = Surface::Unknown;
        }
        if let Some(before) = before.filter(|_| options.motion) {
            let mut motion = motion(options, &before, &seen, motion_bias, rng);
            motion.surface_sigma_px = ground.sigma_px(truth.height_agl_m / options.focal_length_px);
            if let Some(gap) = water {
                drag(&mut motion, options, truth, gap);
            }
            deliver(Input::Motion(motion));
            if ground == Surface::Mapped {
                ground = Surface::Followed;
            }
        }
        before = Some(seen);
        if in_gap.is_some() || rng.random::<f64>() >= options.fix_rate {
            deliver(Input::Miss(Miss { time_s }));
            continue;
        }
        let is_alias = options.alias_share > 0.0 && alias.next(options, rng);
        if !is_alias {
            ground = Surface::Mapped;
        }
        deliver(Input::Fix(fix(
            options,
            truth,
            map_m,
            boresight_rad,
            is_alias.then_some(&alias),
            rng,
        )));
    }
    deliveries
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
    let sample = sample(options, rng);
    let mut seen_m = truth.position_m + centre_m + map_m + Vector2::from(sample.error_en_m);
    if options.fixes.is_some() {
        // The surface that was matched is nearer or further than the ground. Else it is the measured resolution that is off.
        seen_m += centre_m * (sample.gsd_ratio - 1.0);
    }
    let mut stated = sample.confidence;
    if let Some(alias) = alias {
        seen_m += alias.offset_m;
        if options.confidence == Confidence::Calibrated {
            // Half of the score is common to all frames of one wrong place.
            let score = -SEPARATION + 0.5f64.sqrt() * (alias.score + normal(rng));
            stated = confidence(score, options.alias_share.max(LEAST_ALIAS_SHARE));
        }
    }
    PositionFix {
        time_s: truth.time_s,
        lonlat: destination_en_m(options.origin(), seen_m.x, seen_m.y),
        covariance_en_m2: sample.covariance_en_m2,
        map_error_m: options.map_error_m,
        heading_deg: Some(attitude.top_deg() + sample.heading_error_deg),
        gsd_m: truth.height_agl_m / options.focal_length_px
            * gsd_over_nadir(&attitude)
            * sample.gsd_ratio,
        confidence: stated,
    }
}

/// A right fix, turned by any angle: drawn from those that were given, else a normal one.
fn sample(options: &FlightOptions, rng: &mut ChaCha8Rng) -> FixSample {
    let turn = Rotation2::new(rng.random_range(0.0..std::f64::consts::TAU));
    if let Some(samples) = options
        .fixes
        .as_deref()
        .filter(|samples| !samples.is_empty())
    {
        let sample = samples[rng.random_range(0..samples.len())];
        let [ee, en, nn] = sample.covariance_en_m2;
        let turned = turn.matrix() * Matrix2::new(ee, en, en, nn) * turn.matrix().transpose();
        return FixSample {
            error_en_m: (turn * Vector2::from(sample.error_en_m)).into(),
            covariance_en_m2: [turned[(0, 0)], turned[(0, 1)], turned[(1, 1)]],
            ..sample
        };
    }
    // Sigma between 0.5 and 2 m, up to twice as large along one direction.
    let sigma_m = 0.5 * 4f64.powf(rng.random::<f64>());
    let root =
        turn.matrix() * Matrix2::new(sigma_m, 0.0, 0.0, sigma_m * rng.random_range(0.5..1.0));
    let covariance = root * root.transpose();
    let score = SEPARATION + normal(rng);
    FixSample {
        error_en_m: (root * Vector2::new(normal(rng), normal(rng))).into(),
        covariance_en_m2: [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
        confidence: confidence(score, options.alias_share.max(LEAST_ALIAS_SHARE)),
        heading_error_deg: normal(rng),
        gsd_ratio: 1.0 + 0.01 * normal(rng),
    }
}

/// The reported attitude nearest to a time.
fn attitude_at(attitudes: &[Attitude], time_s: f64) -> Option<&Attitude> {
    let after = attitudes.partition_point(|attitude| attitude.time_s < time_s);
    let near = &attitudes[after.saturating_sub(1)..attitudes.len().min(after + 1)];
    let away_s = |attitude: &&Attitude| (attitude.time_s - time_s).abs();
    near.iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b)))
}

/// A frame and by how much its image centre is off where the reported attitude puts it.
#[derive(Debug, Clone, Copy)]
struct Seen<'a> {
    truth: &'a Truth,
    off_m: Vector2<f64>,
}

impl<'a> Seen<'a> {
    /// Where no attitude is reported the camera is taken for one that looks straight down.
    fn new(truth: &'a Truth, reported: Option<&Attitude>, boresight_rad: Vector2<f64>) -> Self {
        let centre_m = |pitch_deg: f64, roll_deg: f64, boresight_rad: Vector2<f64>| {
            let attitude = Attitude {
                time_s: truth.time_s,
                yaw_deg: truth.yaw_deg,
                pitch_deg,
                roll_deg,
            };
            CentreOffset::new(&attitude, boresight_rad, truth.height_agl_m)
                .map_or(Vector2::zeros(), |centre| centre.offset_en_m)
        };
        let reported_m = reported.map_or(Vector2::zeros(), |reported| {
            centre_m(reported.pitch_deg, reported.roll_deg, Vector2::zeros())
        });
        Self {
            truth,
            off_m: centre_m(truth.pitch_deg, truth.roll_deg, boresight_rad) - reported_m,
        }
    }
}

/// Motion between two frames that were levelled with the reported attitude: the error of that attitude moves what each shows.
fn motion(
    options: &FlightOptions,
    before: &Seen<'_>,
    now: &Seen<'_>,
    bias: [f64; 2],
    rng: &mut ChaCha8Rng,
) -> RelativeMotion {
    let off_m = now.off_m - before.off_m;
    let (before, now) = (before.truth, now.truth);
    let gsd_m = before.height_agl_m / options.focal_length_px;
    let moved_px = (now.position_m - before.position_m + off_m) / gsd_m;
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
        surface_sigma_px: None,
    }
}

/// What is known of the surface that a motion is measured over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Surface {
    /// The first frame had a right fix.
    Mapped,
    /// It moved with ground of a frame before.
    Followed,
    /// Water, or nothing tells.
    Unknown,
}

impl Surface {
    fn sigma_px(self, gsd_m: f64) -> Option<f64> {
        match self {
            Self::Mapped => Some(0.0),
            Self::Followed => Some(FOLLOWED_SIGMA_M / gsd_m),
            Self::Unknown => None,
        }
    }
}

/// Over water the waves are seen to move: adds what they moved to a motion. Each gap has a wind of its own.
fn drag(motion: &mut RelativeMotion, options: &FlightOptions, now: &Truth, gap: usize) {
    let wind_rad = (options.seed as f64 + gap as f64) * GOLDEN_ANGLE_RAD;
    let gsd_m = now.height_agl_m / options.focal_length_px;
    let moved_px = WAVES_M_S * (motion.time_s - motion.from_time_s) / gsd_m;
    motion.forward_px -= moved_px * wind_rad.cos();
    motion.right_px -= moved_px * wind_rad.sin();
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
