//! The track of a recorded flight, each point with what came before and after it.

use nalgebra::Vector2;
use serde::Serialize;

use crate::{
    error::OptionsError,
    filter::Filter,
    hypothesis::{FIXES_IN_HISTORY, Hypothesis},
    input::{Input, PositionFix},
    journal::Journal,
    kalman::{POSITION, VELOCITY},
    options::TrackOptions,
    plane::LocalPlane,
    radius::radius95_m,
    rts,
    sensors::Sensors,
};

/// A point of a smoothed track.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct SmoothedPoint {
    /// Seconds on the inputs' clock.
    pub time_s: f64,
    /// Degrees north.
    pub lat_deg: f64,
    /// Degrees east.
    pub lon_deg: f64,
    /// Metres per second to the east.
    pub velocity_east_m_s: f64,
    /// Metres per second to the north.
    pub velocity_north_m_s: f64,
    /// 1-sigma covariance of the position, square metres: east-east, east-north, north-north. It includes the map's error.
    pub covariance_en_m2: [f64; 3],
    /// The position is within this distance with 95 % probability, metres.
    pub radius95_m: f64,
    /// Which piece of the track it belongs to, from 0: pieces are not joined, because the filter changed its mind on where the
    /// aircraft is.
    pub piece: usize,
}

/// Smooths a recorded flight (Rauch, Tung and Striebel 1965).
///
/// A first pass of the filter decides which fixes are right: those that the hypothesis accepted that led half a minute or more
/// later. A second pass takes those alone and smooths them. There is a point for each of these fixes, for each velocity and for
/// each motion between frames. Inputs may come in any order; invalid ones and duplicates are left out.
///
/// # Errors
/// [`OptionsError`] if an option is not finite or out of range.
pub fn smooth(
    inputs: &[Input],
    options: &TrackOptions,
) -> Result<Vec<SmoothedPoint>, OptionsError> {
    options.validate()?;
    let mut in_order: Vec<Input> = inputs
        .iter()
        .filter(|input| input.validate().is_ok())
        .copied()
        .collect();
    in_order.sort_by(Input::order);
    in_order.dedup_by(|a, b| a.order(b).is_eq());
    let roots = accepted_by(&in_order, options);
    let mut points = Vec::new();
    let mut sensors = Sensors::default();
    let mut piece: Option<Piece> = None;
    let mut pieces = 0;
    let mut fix_number = 0;
    for input in &in_order {
        match input {
            Input::Fix(fix) => {
                let root = roots.get(fix_number).copied().flatten();
                fix_number += 1;
                sensors.take(input);
                let Some(root) = root else { continue };
                let fix = &sensors.with_nadir_gsd(fix);
                if let Some(piece) = piece.as_mut().filter(|piece| piece.root == root) {
                    piece.fix(fix, &sensors, options);
                    continue;
                }
                if let Some(ended) = piece.replace(Piece::new(root, fix, &sensors, options)) {
                    ended.finish(pieces, &mut points);
                    pieces += 1;
                }
            }
            other => {
                let turn = sensors.take(other);
                if let Some(piece) = &mut piece {
                    piece.follow(other, turn, &sensors, options);
                }
            }
        }
    }
    if let Some(ended) = piece {
        ended.finish(pieces, &mut points);
    }
    Ok(points)
}

/// For each fix, in order, the founder of the hypothesis that accepted it and led later on.
fn accepted_by(inputs: &[Input], options: &TrackOptions) -> Vec<Option<u64>> {
    let mut filter = Filter::new();
    let mut roots: Vec<Option<u64>> = Vec::new();
    for input in inputs {
        filter.apply(input, options);
        if !matches!(input, Input::Fix(_)) {
            continue;
        }
        roots.push(None);
        let Some(leader) = filter.bank.leader().filter(|_| filter.believed.is_some()) else {
            continue;
        };
        let known = (leader.fixes_seen as usize).min(FIXES_IN_HISTORY);
        for (back, root) in roots.iter_mut().rev().take(known).enumerate() {
            *root = (leader.history >> back & 1 == 1).then_some(leader.root);
        }
    }
    roots
}

/// A part of the track that one hypothesis follows.
struct Piece {
    root: u64,
    plane: LocalPlane,
    hypothesis: Hypothesis,
}

impl Piece {
    fn new(root: u64, fix: &PositionFix, sensors: &Sensors, options: &TrackOptions) -> Self {
        let plane = LocalPlane::new(fix.lonlat);
        let measured_m = plane.en_from_lonlat(fix.lonlat);
        let mut hypothesis = Hypothesis::from_fix(0, fix, measured_m, sensors, options);
        hypothesis.journal = Some(Box::new(Journal::new()));
        hypothesis.write_epoch();
        Self {
            root,
            plane,
            hypothesis,
        }
    }

    fn fix(&mut self, fix: &PositionFix, sensors: &Sensors, options: &TrackOptions) {
        self.hypothesis.propagate(fix.time_s, options);
        let view = sensors.view_of(fix, options);
        self.hypothesis.look(view, options);
        let measured_m = self.plane.en_from_lonlat(fix.lonlat);
        if let Some(innovation) = self.hypothesis.innovation(fix, measured_m, view, options) {
            self.hypothesis.accept(fix, &innovation, options);
        }
    }

    fn follow(
        &mut self,
        input: &Input,
        turn: Option<(f64, f64)>,
        sensors: &Sensors,
        options: &TrackOptions,
    ) {
        match input {
            Input::Attitude(attitude) => {
                self.hypothesis.attitude(attitude, turn, options);
            }
            Input::Height(_) => {
                if let Some((_, factor)) = turn {
                    self.hypothesis.climb(factor);
                }
            }
            Input::Velocity(velocity) => {
                self.hypothesis.velocity(velocity, options);
                self.hypothesis.write_epoch();
            }
            Input::Motion(motion) => {
                self.hypothesis.motion(motion, sensors, options);
                self.hypothesis.write_epoch();
            }
            Input::Fix(_) | Input::Miss(_) => {}
        }
    }

    fn finish(self, piece: usize, points: &mut Vec<SmoothedPoint>) {
        let Some(journal) = self.hypothesis.journal else {
            return;
        };
        for ((mean, covariance), (time_s, reference_m_s)) in
            rts::smooth(&journal.epochs).into_iter().zip(journal.at)
        {
            let position_m: Vector2<f64> = mean.fixed_rows::<2>(POSITION).into_owned();
            let velocity_m_s = reference_m_s + mean.fixed_rows::<2>(VELOCITY);
            let covariance_m2 = covariance
                .fixed_view::<2, 2>(POSITION, POSITION)
                .into_owned();
            let place = self.plane.lonlat_from_en(position_m);
            let point = SmoothedPoint {
                time_s,
                lat_deg: place.lat_deg,
                lon_deg: place.lon_deg,
                velocity_east_m_s: velocity_m_s.x,
                velocity_north_m_s: velocity_m_s.y,
                covariance_en_m2: [
                    covariance_m2[(0, 0)],
                    covariance_m2[(0, 1)],
                    covariance_m2[(1, 1)],
                ],
                radius95_m: radius95_m(&covariance_m2),
                piece,
            };
            // Epochs of one time: the last one has the most in it.
            match points.last_mut() {
                Some(last) if last.time_s == time_s && last.piece == piece => *last = point,
                _ => points.push(point),
            }
        }
    }
}
