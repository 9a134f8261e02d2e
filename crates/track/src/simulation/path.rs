//! Where a simulated aircraft is, how it moves and how it leans.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::{camera::Camera, errors::Drift, options::FlightOptions};
use crate::options::Vehicle;

/// The truth at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Truth {
    pub time_s: f64,
    pub position_m: Vector2<f64>,
    pub velocity_m_s: Vector2<f64>,
    pub height_agl_m: f64,
    /// Of the camera's frame, degrees.
    pub yaw_deg: f64,
    pub pitch_deg: f64,
    pub roll_deg: f64,
}

/// Step of the integration, seconds.
pub(super) const STEP_S: f64 = 0.05;
/// Beyond this part of its area's half side an aircraft that flies outward turns back.
const EDGE: f64 = 0.7;
/// Metres per square second.
const GRAVITY_M_S2: f64 = 9.81;

/// The truth at a time, in steps of [`STEP_S`].
pub(super) fn truth_at(path: &[Truth], time_s: f64) -> &Truth {
    let index = (time_s / STEP_S).round().max(0.0) as usize;
    &path[index.min(path.len() - 1)]
}

/// Flies legs and coordinated turns in wind and gusts. In an area it turns back at the edge, and being put elsewhere is part of
/// the path.
///
/// One function, though a long one: each step of the integration reads and writes all of the aircraft's state, and the order of the
/// random numbers makes the flight.
pub(super) fn fly(options: &FlightOptions, rng: &mut ChaCha8Rng) -> Vec<Truth> {
    let FlightOptions {
        vehicle,
        camera,
        duration_s,
        height_agl_m,
        ..
    } = *options;
    let (air_speed_m_s, bank_deg): (f64, f64) = match vehicle {
        Vehicle::Multirotor => (rng.random_range(6.0..12.0), rng.random_range(8.0..15.0)),
        Vehicle::Plane => (rng.random_range(17.0..24.0), rng.random_range(15.0..30.0)),
    };
    let wind_from: f64 = rng.random_range(0.0..std::f64::consts::TAU);
    let wind_m_s = Vector2::new(wind_from.sin(), wind_from.cos()) * rng.random_range(0.0..6.0);
    let mut gusts = [0, 1].map(|_| Drift::new(0.7, 3.0, rng));
    let mut sway =
        [0, 1].map(|_| Drift::new(if camera == Camera::Gimbal { 0.4 } else { 1.5 }, 1.0, rng));
    // A multirotor leans forward to fly; a plane flies with a small angle of attack.
    let trim_deg = match vehicle {
        Vehicle::Multirotor => -rng.random_range(3.0..9.0),
        Vehicle::Plane => rng.random_range(1.0..5.0),
    };
    let mut heading_rad: f64 = rng.random_range(0.0..std::f64::consts::TAU);
    let mut height_m = Drift::new(0.03 * height_agl_m, 40.0, rng);
    let mut position_m = Vector2::zeros();
    let mut bank_rad: f64 = 0.0;
    let (mut leg_left_s, mut turn_left_rad): (f64, f64) = (rng.random_range(10.0..50.0), 0.0);
    let steps = (duration_s / STEP_S).round() as usize;
    let mut path = Vec::with_capacity(steps + 1);
    let mut jump_s = options.put_elsewhere_s.filter(|_| options.area.is_some());
    for step in 0..=steps {
        if let Some(area) = options.area {
            if jump_s.is_some_and(|jump_s| step as f64 * STEP_S >= jump_s) {
                jump_s = None;
                // Across the centre, so that it is another place.
                let side_m = rng.random_range(0.3..0.7) * area.half_side_m;
                position_m = -position_m.try_normalize(1.0).unwrap_or_else(Vector2::x) * side_m;
            }
            let ahead = Vector2::new(heading_rad.sin(), heading_rad.cos());
            let leaves =
                position_m.amax() > EDGE * area.half_side_m && position_m.dot(&ahead) > 0.0;
            if leaves && leg_left_s > 0.0 {
                let back_rad = (-position_m.x).atan2(-position_m.y) + rng.random_range(-0.5..0.5);
                let turn = (back_rad - heading_rad + PI).rem_euclid(TAU) - PI;
                (leg_left_s, turn_left_rad) = (0.0, turn);
            }
        }
        let wanted_rad = if leg_left_s > 0.0 {
            leg_left_s -= STEP_S;
            if leg_left_s <= 0.0 {
                let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
                turn_left_rad = side * rng.random_range(40f64..180.0).to_radians();
            }
            0.0
        } else {
            bank_deg.to_radians().copysign(turn_left_rad)
        };
        // The bank follows with a time constant of half a second.
        bank_rad += (wanted_rad - bank_rad) * (STEP_S / 0.5);
        let turn_rad = GRAVITY_M_S2 * bank_rad.tan() / air_speed_m_s * STEP_S;
        heading_rad += turn_rad;
        if leg_left_s <= 0.0 {
            let left = turn_left_rad - turn_rad;
            if left * turn_left_rad <= 0.0 {
                leg_left_s = rng.random_range(10.0..50.0);
            } else {
                turn_left_rad = left;
            }
        }
        let gust_m_s = Vector2::from(gusts.each_mut().map(|gust| gust.step(STEP_S, rng)));
        let air_m_s = Vector2::new(heading_rad.sin(), heading_rad.cos()) * air_speed_m_s;
        let velocity_m_s = air_m_s + wind_m_s + gust_m_s;
        let sway_deg = sway.each_mut().map(|sway| sway.step(STEP_S, rng));
        let (pitch_deg, roll_deg) = match camera {
            Camera::Fixed => (trim_deg + sway_deg[0], bank_rad.to_degrees() + sway_deg[1]),
            Camera::Gimbal => (sway_deg[0], sway_deg[1]),
        };
        path.push(Truth {
            time_s: step as f64 * STEP_S,
            position_m,
            velocity_m_s,
            height_agl_m: height_agl_m + height_m.step(STEP_S, rng),
            yaw_deg: heading_rad.to_degrees().rem_euclid(360.0),
            pitch_deg,
            roll_deg,
        });
        position_m += velocity_m_s * STEP_S;
    }
    path
}
