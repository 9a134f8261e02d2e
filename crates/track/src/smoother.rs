//! The track of a recorded flight, each point with what came before and after it.

use nalgebra::{Matrix2, Vector2};
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
    sensors::{Change, Sensors},
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
    /// Whether a fix of this time is part of the track.
    pub is_fix: bool,
    /// Which piece of the track it belongs to, from 0: pieces are not joined, because the filter changed its mind on where the
    /// aircraft is.
    pub piece: usize,
}

/// Smooths a recorded flight (Rauch, Tung and Striebel 1965).
///
/// A first pass of the filter decides which fixes are right: those that the hypothesis accepted that led 127 fixes later, or at the
/// end. A second pass takes those alone and smooths them. There is a point for each of these fixes, for each velocity that an
/// aircraft can have and for each motion between frames. Inputs may come in any order; invalid ones and duplicates are left out.
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
        let change = sensors.take(input);
        if sensors.looks_too_far_aside(input, options) {
            continue;
        }
        match input {
            Input::Fix(fix) => {
                let root = roots.get(fix_number).copied().flatten();
                fix_number += 1;
                let Some(root) = root else { continue };
                let fix = &sensors.levelled(fix);
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
                if let Some(piece) = &mut piece {
                    piece.follow(other, change, &sensors, options);
                }
            }
        }
    }
    if let Some(ended) = piece {
        ended.finish(pieces, &mut points);
    }
    Ok(points)
}

/// For each fix that the filter takes in, in order, the founder of the hypothesis that accepted it and led later on.
fn accepted_by(inputs: &[Input], options: &TrackOptions) -> Vec<Option<u64>> {
    let mut filter = Filter::new(false);
    let mut roots: Vec<Option<u64>> = Vec::new();
    for input in inputs {
        filter.apply(input, options);
        let is_left_out = filter.sensors.looks_too_far_aside(input, options);
        if !matches!(input, Input::Fix(_)) || is_left_out {
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
    /// The planes before it, and how many epochs were written by the end of each.
    former_planes: Vec<(usize, LocalPlane)>,
    hypothesis: Hypothesis,
    /// Times of the fixes that it accepted, in order.
    fixes_s: Vec<f64>,
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
            former_planes: Vec::new(),
            hypothesis,
            fixes_s: vec![fix.time_s],
        }
    }

    fn fix(&mut self, fix: &PositionFix, sensors: &Sensors, options: &TrackOptions) {
        self.hypothesis.propagate(fix.time_s, options);
        let view = sensors.view_of(fix, options);
        self.hypothesis.look(view);
        let measured_m = self.plane.en_from_lonlat(fix.lonlat);
        if let Some(innovation) = self.hypothesis.innovation(fix, measured_m, view, options) {
            self.hypothesis.accept(fix, &innovation, options);
            self.fixes_s.push(fix.time_s);
        }
        self.re_anchor();
    }

    /// Moves the plane where the aircraft went far from its origin, as the filter does.
    fn re_anchor(&mut self) {
        let position_m = self.hypothesis.position_m();
        let Some(moved) = self.plane.moved_to(position_m) else {
            return;
        };
        let turn = self.plane.turn_to(&moved, position_m);
        self.hypothesis.re_anchor(Vector2::zeros(), turn);
        let journal = self.hypothesis.journal.as_ref();
        let epochs = journal.map_or(0, |journal| journal.epochs.len());
        self.former_planes.push((epochs, self.plane));
        self.plane = moved;
    }

    fn follow(
        &mut self,
        input: &Input,
        change: Option<Change>,
        sensors: &Sensors,
        options: &TrackOptions,
    ) {
        match input {
            Input::Attitude(attitude) => {
                self.hypothesis.attitude(attitude, change, options);
            }
            Input::Height(_) => {
                if let Some(Change::Climb(climb)) = change {
                    self.hypothesis.climb(climb);
                }
            }
            Input::Velocity(velocity) => {
                if let Some(Change::Velocity(how)) = change {
                    self.hypothesis.velocity(velocity, how, options);
                    self.hypothesis.write_epoch();
                }
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
        let begin = points.len();
        let forgets_velocity = journal.epochs.get(1).is_some_and(|second| {
            let remains = second
                .transition
                .fixed_view::<2, 2>(VELOCITY, VELOCITY)
                .into_owned();
            remains == Matrix2::zeros()
        });
        let plane_of = |number: usize| {
            let mut former = self.former_planes.iter();
            former
                .find(|(end, _)| number < *end)
                .map_or(self.plane, |(_, plane)| *plane)
        };
        let smoothed = rts::smooth(&journal.epochs).into_iter().zip(journal.at);
        for (number, ((mean, covariance), (time_s, reference_m_s))) in smoothed.enumerate() {
            let position_m: Vector2<f64> = mean.fixed_rows::<2>(POSITION).into_owned();
            let velocity_m_s = reference_m_s + mean.fixed_rows::<2>(VELOCITY);
            let covariance_m2 = covariance
                .fixed_view::<2, 2>(POSITION, POSITION)
                .into_owned();
            let place = plane_of(number).lonlat_from_en(position_m);
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
                is_fix: self
                    .fixes_s
                    .binary_search_by(|fix_s| fix_s.total_cmp(&time_s))
                    .is_ok(),
                piece,
            };
            // Epochs of one time: the last one has the most in it.
            match points.last_mut() {
                Some(last) if last.time_s == time_s && last.piece == piece => *last = point,
                _ => points.push(point),
            }
        }
        // Nothing told the velocity at the first fix but the motion since then, which began with an error of its own.
        if let Some([first, second]) = points.get_mut(begin..).and_then(|of| of.first_chunk_mut())
            && forgets_velocity
        {
            first.velocity_east_m_s = second.velocity_east_m_s;
            first.velocity_north_m_s = second.velocity_north_m_s;
        }
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::{LonLat, destination_en_m, distance_m};
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::{
        attitude::Attitude,
        gauss_markov::GaussMarkov,
        input::{Height, RelativeMotion, Velocity},
        options::Vehicle,
        tilt_error::{attitude_tilt_error, unknown_tilt},
    };

    const HERE: LonLat = LonLat::new(120.7, 24.2);
    const HEIGHT_AGL_M: f64 = 100.0;
    const MAP_ERROR_M: f64 = 1.5;
    const FIX_SIGMA_M: f64 = 0.7;
    const VELOCITY_SIGMA_M_S: f64 = 0.4;
    const SPEED_M_S: f64 = 6.0;
    const FIXES: usize = 40;
    const INTERVAL_S: f64 = 1.5;

    /// How far a fix is off the path of the reported velocity to one side, metres.
    fn off_m(number: usize) -> f64 {
        let time_s = INTERVAL_S * number as f64;
        3.0 * (0.1 * time_s).sin() + 0.8 * (2.3 * time_s).cos()
    }

    /// A flight to the north with a constant reported velocity, level, with or without attitude.
    fn inputs(with_attitude: bool) -> Vec<Input> {
        let plane = LocalPlane::new(HERE);
        let mut inputs = Vec::new();
        for number in 0..FIXES {
            let time_s = INTERVAL_S * number as f64;
            inputs.push(Input::Velocity(Velocity {
                time_s,
                east_m_s: 0.0,
                north_m_s: SPEED_M_S,
                sigma_m_s: VELOCITY_SIGMA_M_S,
            }));
            if with_attitude {
                inputs.push(Input::Attitude(Attitude {
                    time_s,
                    yaw_deg: 0.0,
                    pitch_deg: 0.0,
                    roll_deg: 0.0,
                }));
            }
            inputs.push(Input::Height(Height {
                time_s,
                agl_m: HEIGHT_AGL_M,
                amsl_m: None,
            }));
            let place_m = Vector2::new(off_m(number), SPEED_M_S * time_s + off_m(number + 7));
            inputs.push(Input::Fix(PositionFix {
                time_s,
                lonlat: plane.lonlat_from_en(place_m),
                covariance_en_m2: [FIX_SIGMA_M.powi(2), 0.0, FIX_SIGMA_M.powi(2)],
                map_error_m: MAP_ERROR_M,
                heading_deg: Some(0.0),
                gsd_m: 0.05,
                confidence: 0.995,
            }));
        }
        inputs
    }

    /// Covariance of the integrals up to two times of a Gauss-Markov process that begins with the variance `first`, from its
    /// autocovariance `sigma^2 exp(-|t - u| / tau)`.
    fn integrals(process: &GaussMarkov, first: f64, t_s: f64, u_s: f64) -> f64 {
        let tau = process.correlation_s;
        let remains = |s: f64| (-s / tau).exp();
        let stationary = (process.sigma * tau).powi(2)
            * (2.0 * t_s.min(u_s) / tau - 1.0 + remains(t_s) + remains(u_s)
                - remains((t_s - u_s).abs()));
        let carried = tau * tau * (1.0 - remains(t_s)) * (1.0 - remains(u_s));
        stationary + (first - process.sigma.powi(2)) * carried
    }

    /// Means of the position along one axis relative to the reported path, and their covariance, given all fixes at once: the first
    /// position is unknown (generalised least squares), all else is a covariance between two times and no recursion.
    fn batch(
        tilt: &GaussMarkov,
        constant_m2: f64,
        speed_m_s: f64,
        measured_m: &DVector<f64>,
        options: &TrackOptions,
    ) -> (DVector<f64>, DMatrix<f64>) {
        let drift = GaussMarkov {
            sigma: VELOCITY_SIGMA_M_S,
            correlation_s: options.velocity_correlation_s,
        };
        let (free, stated) = (
            Vehicle::default().speed_sigma_m_s().powi(2),
            VELOCITY_SIGMA_M_S.powi(2),
        );
        let first = free * stated / (free + stated);
        // The usual speed of zero counts a little beside the first reported velocity.
        let slower_m_s = speed_m_s * stated / (free + stated);
        let time_s = |number: usize| INTERVAL_S * number as f64;
        let path = DMatrix::from_fn(FIXES, FIXES, |i, k| {
            integrals(&drift, first, time_s(i), time_s(k))
        });
        let seen = DMatrix::from_fn(FIXES, FIXES, |i, k| {
            let apart_s = (time_s(i) - time_s(k)).abs();
            let lean = (HEIGHT_AGL_M * tilt.sigma).powi(2) * (-apart_s / tilt.correlation_s).exp();
            let white = if i == k { FIX_SIGMA_M.powi(2) } else { 0.0 };
            path[(i, k)] + lean + constant_m2 + white
        });
        let inverse = seen.try_inverse().unwrap();
        let known_m = DVector::from_fn(FIXES, |number, _| {
            let tau = drift.correlation_s;
            -slower_m_s * tau * (1.0 - (-time_s(number) / tau).exp())
        });
        let measured_m = measured_m - &known_m;
        let ones = DVector::from_element(FIXES, 1.0);
        let information = (ones.transpose() * &inverse * &ones)[(0, 0)];
        let first_m = (ones.transpose() * &inverse * &measured_m)[(0, 0)] / information;
        let gain = &path * &inverse;
        let mean = known_m + &ones * first_m + &gain * (measured_m - &ones * first_m);
        let left = &ones - &gain * &ones;
        let covariance = &path - &gain * path.transpose() + &left * left.transpose() / information;
        (mean, covariance)
    }

    #[test]
    fn where_photos_alone_tell_the_velocity_every_point_has_it() {
        let mut inputs = inputs(true);
        inputs.retain(|input| !matches!(input, Input::Velocity(_)));
        for number in 1..FIXES {
            inputs.push(Input::Motion(RelativeMotion {
                from_time_s: INTERVAL_S * (number - 1) as f64,
                time_s: INTERVAL_S * number as f64,
                forward_px: SPEED_M_S * INTERVAL_S / 0.05,
                right_px: 0.0,
                turn_deg: 0.0,
                sigma_px: 2.0,
                surface_sigma_px: Some(0.0),
            }));
        }
        let points = smooth(&inputs, &TrackOptions::default()).unwrap();
        assert_eq!(points.len(), FIXES);
        for point in points {
            let off_m_s = (point.velocity_north_m_s - SPEED_M_S).hypot(point.velocity_east_m_s);
            assert!(off_m_s < 1.5, "{point:?}");
        }
    }

    /// To the east from 60 degrees north, where directions turn by 1.2 degrees in 80 km.
    #[test]
    fn far_from_the_first_fix_east_is_east() {
        const EAST_M_S: f64 = 50.0;
        let mut places = vec![LonLat::new(179.5, 60.0)];
        let mut inputs = Vec::new();
        for second in 0..1600 {
            let (time_s, place) = (f64::from(second), places[places.len() - 1]);
            inputs.push(Input::Velocity(Velocity {
                time_s,
                east_m_s: EAST_M_S,
                north_m_s: 0.0,
                sigma_m_s: VELOCITY_SIGMA_M_S,
            }));
            if second % 10 == 0 {
                inputs.push(Input::Fix(PositionFix {
                    time_s,
                    lonlat: place,
                    covariance_en_m2: [FIX_SIGMA_M.powi(2), 0.0, FIX_SIGMA_M.powi(2)],
                    map_error_m: MAP_ERROR_M,
                    heading_deg: Some(90.0),
                    gsd_m: 0.05,
                    confidence: 0.995,
                }));
            }
            places.push(destination_en_m(place, EAST_M_S, 0.0));
        }
        let points = smooth(&inputs, &TrackOptions::default()).unwrap();
        assert_eq!(points.len(), 1600);
        for point in points {
            let east_off_m_s = point.velocity_east_m_s - EAST_M_S;
            let off_m_s = east_off_m_s.hypot(point.velocity_north_m_s);
            assert!(off_m_s < 0.5, "{point:?}");
            let place = LonLat::new(point.lon_deg, point.lat_deg);
            let off_m = distance_m(place, places[point.time_s as usize]);
            assert!(off_m < 2.0, "{off_m} m: {point:?}");
        }
    }

    #[test]
    fn it_is_what_a_batch_of_all_fixes_gives() {
        let options = TrackOptions::default();
        let boresight_m = HEIGHT_AGL_M * options.boresight_sigma_deg.to_radians();
        for (with_attitude, tilt, boresight_m2) in [
            (true, attitude_tilt_error(&options), boresight_m.powi(2)),
            (false, unknown_tilt(&options), 0.0),
        ] {
            let points = smooth(&inputs(with_attitude), &options).unwrap();
            assert_eq!(points.len(), FIXES);
            let constant_m2 = MAP_ERROR_M.powi(2) + boresight_m2;
            let along = |from: usize, speed_m_s: f64| {
                let measured_m = DVector::from_fn(FIXES, |number, _| off_m(number + from));
                batch(&tilt, constant_m2, speed_m_s, &measured_m, &options)
            };
            let ((east_m, covariance_m2), (north_m, _)) = (along(0, 0.0), along(7, SPEED_M_S));
            let plane = LocalPlane::new(HERE);
            for (number, point) in points.iter().enumerate() {
                let place = LonLat::new(point.lon_deg, point.lat_deg);
                let at_m = plane.en_from_lonlat(place);
                let path_m = SPEED_M_S * point.time_s;
                let off_m = at_m - Vector2::new(east_m[number], path_m + north_m[number]);
                assert!(off_m.norm() < 1e-3, "{with_attitude} {number}: {off_m}");
                let [ee, en, nn] = point.covariance_en_m2;
                let expected = covariance_m2[(number, number)];
                for variance in [ee, nn] {
                    assert!(
                        (variance / expected - 1.0).abs() < 1e-4,
                        "{with_attitude} {number}: {variance}, and is {expected}"
                    );
                }
                assert!(en.abs() < 1e-6);
            }
        }
    }
}
