//! The state vector of a hypothesis and its update.
//!
//! The state has twelve components, in metres, metres per second and radians:
//!
//! | index | what | treatment |
//! |---|---|---|
//! | 0, 1 | position east, north | estimated |
//! | 2, 3 | velocity minus the reference velocity | estimated |
//! | 4, 5 | boresight: tilt of the camera forward, right | estimated, constant |
//! | 6, 7 | the map's error east, north | considered, constant |
//! | 8, 9 | error of the reported attitude's tilt to the east, north | considered, Gauss-Markov |
//! | 10, 11 | tilt to the east, north while no attitude is known | considered, Gauss-Markov |
//!
//! The two tilts are errors of two kinds of views. Neither begins again where views of the other kind came between: a tilt that is the same
//! each time must not average away.
//!
//! "Considered" states (S. F. Schmidt, "Application of State-Space Methods to Navigation Problems", 1966; Bar-Shalom et al.
//! 2001, section 11.7) keep their mean of zero and their variance, but their correlation with the others is carried: what all
//! fixes have in common does not shrink with their number.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// Components of the state.
pub(crate) const STATE: usize = 12;
/// The first so many are estimated, the others considered.
pub(crate) const ESTIMATED: usize = 6;
pub(crate) const POSITION: usize = 0;
pub(crate) const VELOCITY: usize = 2;
pub(crate) const BORESIGHT: usize = 4;
pub(crate) const MAP: usize = 6;
pub(crate) const TILT: usize = 8;
pub(crate) const UNKNOWN_TILT: usize = 10;

/// Mean or gain.
pub(crate) type State = SVector<f64, STATE>;
/// Covariance.
pub(crate) type Covariance = SMatrix<f64, STATE, STATE>;
/// How a measured position depends on the state.
pub(crate) type Observation = SMatrix<f64, 2, STATE>;

/// Schmidt's update: the gain of all but the first `estimated` states is zero. For any gain the covariance is
/// `P - K (P H^T)^T - P H^T K^T + K S K^T` (Bar-Shalom et al. 2001, equation 5.2.3-18, Joseph's form).
pub(crate) fn update(
    mean: &mut State,
    state_covariance: &mut Covariance,
    observation: &Observation,
    innovation: Vector2<f64>,
    covariance: Matrix2<f64>,
    estimated: usize,
) {
    let Some(inverse) = covariance.try_inverse() else {
        return;
    };
    let cross: SMatrix<f64, STATE, 2> = *state_covariance * observation.transpose();
    let mut gain = cross * inverse;
    gain.rows_mut(estimated, STATE - estimated).fill(0.0);
    *mean += gain * innovation;
    let change: Covariance = gain * cross.transpose();
    *state_covariance += gain * covariance * gain.transpose() - change - change.transpose();
    *state_covariance = (*state_covariance + state_covariance.transpose()) * 0.5;
}

/// Sets two neighbouring entries of the diagonal.
pub(crate) fn set_diagonal(covariance: &mut Covariance, at: usize, variance: f64) {
    covariance[(at, at)] = variance;
    covariance[(at + 1, at + 1)] = variance;
}
