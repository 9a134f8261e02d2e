//! The three runs that are always compared: fixes only, motion only, and the filter.

use grimnet_geo::{LonLat, destination_en_m, offset_en_m};
use nalgebra::{Matrix2, Vector2};

use super::flight::Flight;
use crate::{
    attitude::Attitude,
    error::OptionsError,
    input::Input,
    measure::{Answer, Instant},
    options::TrackOptions,
    radius::radius95_m,
    tilt::CentreOffset,
    tracker::Tracker,
};

/// Instants of the three runs of one flight.
#[derive(Debug, Clone)]
pub struct Runs {
    /// The last fix, held until the next frame's is due.
    pub fixes_only: Vec<Instant>,
    /// Dead reckoning from the true start.
    pub motion_only: Vec<Instant>,
    /// The filter.
    pub filter: Vec<Instant>,
}

impl Runs {
    /// Runs all three.
    ///
    /// # Errors
    /// [`OptionsError`] if the filter's options are invalid.
    pub fn new(flight: &Flight, options: &TrackOptions) -> Result<Self, OptionsError> {
        Ok(Self {
            fixes_only: fixes_only(flight, options),
            motion_only: motion_only(flight, options),
            filter: run_filter(flight, options)?,
        })
    }
}

/// The filter, asked for the present five times a second while inputs arrive as they do.
///
/// # Errors
/// [`OptionsError`] if the options are invalid.
pub fn run_filter(flight: &Flight, options: &TrackOptions) -> Result<Vec<Instant>, OptionsError> {
    let mut tracker = Tracker::new(options.clone())?;
    let mut deliveries = flight.deliveries.iter().peekable();
    Ok(flight
        .instants_s()
        .map(|time_s| {
            while let Some(delivered) = deliveries.next_if(|d| d.arrival_s <= time_s) {
                // What is refused is counted by the tracker.
                let _ = tracker.push(delivered.input);
            }
            Instant::of(
                tracker.point_at(time_s).as_ref(),
                time_s,
                flight.truth_at(time_s),
            )
        })
        .collect())
}

/// The last fix, put right for attitude and height where they are reported, held for a frame and a half.
pub fn fixes_only(flight: &Flight, options: &TrackOptions) -> Vec<Instant> {
    let hold_s = 1.5 / flight.options.frame_rate_hz;
    let mut deliveries = flight.deliveries.iter().peekable();
    let (mut attitude, mut height_agl_m): (Option<Attitude>, Option<f64>) = (None, None);
    let mut last: Option<(f64, LonLat, Matrix2<f64>)> = None;
    flight
        .instants_s()
        .map(|time_s| {
            while let Some(delivered) = deliveries.next_if(|d| d.arrival_s <= time_s) {
                match delivered.input {
                    Input::Attitude(reported) => attitude = Some(reported),
                    Input::Height(reported) => height_agl_m = Some(reported.agl_m),
                    Input::Fix(fix) => {
                        let [ee, en, nn] = fix.covariance_en_m2;
                        let mut covariance = Matrix2::new(ee, en, en, nn)
                            + Matrix2::identity() * fix.map_error_m.powi(2);
                        let mut place = fix.lonlat;
                        let centre = attitude
                            .zip(height_agl_m)
                            .and_then(|(a, h)| CentreOffset::new(&a, Vector2::zeros(), h));
                        if let Some(centre) = centre {
                            place = destination_en_m(
                                place,
                                -centre.offset_en_m.x,
                                -centre.offset_en_m.y,
                            );
                            let sigma_deg = options
                                .attitude_sigma_deg
                                .hypot(options.boresight_sigma_deg);
                            covariance += centre.by_tilt_m
                                * centre.by_tilt_m.transpose()
                                * sigma_deg.to_radians().powi(2);
                        }
                        last = Some((fix.time_s, place, covariance));
                    }
                    _ => {}
                }
            }
            let answer = last
                .filter(|(fix_s, _, _)| time_s - fix_s <= hold_s)
                .map(|(_, place, covariance)| answer(flight.truth_at(time_s), place, &covariance));
            Instant { time_s, answer }
        })
        .collect()
}

/// The control: velocity, else motion between frames, added up from the true start. Without either there is no answer.
pub fn motion_only(flight: &Flight, options: &TrackOptions) -> Vec<Instant> {
    let mut by_time: Vec<Input> = flight.deliveries.iter().map(|d| d.input).collect();
    by_time.sort_by(|a, b| a.time_s().total_cmp(&b.time_s()));
    let mut inputs = by_time.into_iter().peekable();
    let start = flight.truth_at(0.0);
    let (mut place_m, mut velocity_m_s, mut at_s) = (Vector2::zeros(), Vector2::zeros(), 0.0);
    let (mut yaw_deg, mut length_m) = (0.0f64, 0.0f64);
    let mut sigma_m_s = 0.0;
    let moves = flight.options.velocity || flight.options.motion;
    flight
        .instants_s()
        .map(|time_s| {
            while let Some(input) = inputs.next_if(|input| input.time_s() <= time_s) {
                match input {
                    Input::Velocity(v) => {
                        let now_m_s = Vector2::new(v.east_m_s, v.north_m_s);
                        place_m += (velocity_m_s + now_m_s) * (0.5 * (v.time_s - at_s));
                        (velocity_m_s, at_s, sigma_m_s) = (now_m_s, v.time_s, v.sigma_m_s);
                    }
                    Input::Attitude(attitude) => yaw_deg = attitude.yaw_deg,
                    Input::Motion(motion) if !flight.options.velocity => {
                        let gsd_m = flight.options.height_agl_m / flight.options.focal_length_px;
                        let (sin, cos) = (yaw_deg - motion.turn_deg).to_radians().sin_cos();
                        let step_m = Vector2::new(
                            motion.forward_px * sin + motion.right_px * cos,
                            motion.forward_px * cos - motion.right_px * sin,
                        ) * gsd_m;
                        place_m += step_m;
                        length_m += step_m.norm();
                        at_s = motion.time_s;
                    }
                    _ => {}
                }
            }
            let now_m = place_m + velocity_m_s * (time_s - at_s);
            let place = destination_en_m(start, now_m.x, now_m.y);
            let sigma_m = (sigma_m_s * time_s)
                .max(options.motion_sigma * length_m)
                .max(1.0);
            let covariance = Matrix2::identity() * (sigma_m * sigma_m);
            Instant {
                time_s,
                answer: moves.then(|| answer(flight.truth_at(time_s), place, &covariance)),
            }
        })
        .collect()
}

fn answer(truth: LonLat, place: LonLat, covariance: &Matrix2<f64>) -> Answer {
    let (east_m, north_m) = offset_en_m(truth, place);
    Answer {
        error_en_m: [east_m, north_m],
        covariance_en_m2: [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
        radius95_m: radius95_m(covariance),
    }
}
