//! Calibration: fits how far a model's answers are off and how often they are wrong to answers whose truth is known.
//!
//! [`scenes`] makes maps and photos with exact truth; [`trial`] localises each photo on its own map and on another, with the gates
//! nearly open, and an [`observer`] collects the answers; [`position`] and [`confidence`] fit the two parts of a [`Calibration`] to the
//! answers. Photos of one scene are never on both sides of a check.

pub mod confidence;
mod cut;
mod error;
mod normal;
pub mod observation;
pub mod observer;
mod photo_count;
pub mod position;
pub mod real;
pub mod scenes;
pub mod trial;

use grimnet_locate::Gates;
use grimnet_net::{Calibration, FittedOn};

pub use error::FitError;
use observation::Observation;
pub use photo_count::PhotoCount;

/// Fits both parts to all observations, so that a share `elsewhere_answered` of photos taken elsewhere gets a fix. The figures on
/// held-out scenes come from fitting to each half of the scenes and checking on the other half.
///
/// # Errors
/// Too few observations to fit anything.
pub fn fit(
    observations: &[Observation],
    data: &str,
    elsewhere_answered: f64,
) -> Result<Calibration, FitError> {
    let limiting = confidence::Limiting::of(observations);
    let mut calibration = fit_once(observations, elsewhere_answered, limiting)?;
    let mut held_out = Check::default();
    for side in [0, 1] {
        let (checked, fitted): (Vec<&Observation>, Vec<&Observation>) =
            observations.iter().partition(|o| o.scene % 2 == side);
        let owned: Vec<Observation> = fitted.into_iter().cloned().collect();
        let half = fit_once(&owned, elsewhere_answered, limiting).map_err(FitError::of_half)?;
        held_out.add(&half, &checked);
    }
    let count =
        |wanted: &dyn Fn(&Observation) -> bool| observations.iter().filter(|o| wanted(o)).count();
    calibration.fitted_on = Some(FittedOn {
        data: data.to_owned(),
        photos: count(&|o| !o.elsewhere),
        fixes: count(&|o| o.is_right() && !o.real),
        elsewhere: count(&|o| o.elsewhere),
        held_out_coverage_95: share(held_out.covered, held_out.right),
        held_out_availability: share(held_out.answered, held_out.here),
        held_out_elsewhere: held_out.elsewhere,
        held_out_elsewhere_answered: held_out.elsewhere_answered,
    });
    Ok(calibration)
}

fn fit_once(
    observations: &[Observation],
    elsewhere_answered: f64,
    limiting: confidence::Limiting,
) -> Result<Calibration, FitError> {
    Ok(Calibration {
        position: position::fit(observations)?,
        confidence: Some(confidence::fit(observations, elsewhere_answered, limiting)?),
        fitted_on: None,
    })
}

/// Returns whether an observation would get a fix under `calibration` and the default gates.
#[must_use]
pub fn is_answered(observation: &Observation, calibration: &Calibration) -> bool {
    let mut gates = Gates::default();
    if calibration.confidence.is_some() {
        gates = gates.with_calibration();
    }
    let Some(answer) = &observation.answer else {
        return false;
    };
    let support = &answer.support;
    let confident = calibration.confidence.is_none_or(|model| {
        gates
            .check_confidence(support.confidence(&model), model.needed)
            .is_ok()
    });
    confident
        && support.inliers >= gates.min_inliers
        && gates
            .check_margin(support.inliers, support.runner_up_inliers)
            .is_ok()
        && gates.check_on_map(support.on_map).is_ok()
}

/// How a calibration performs on observations that it was not fitted to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Check {
    /// Photos on their own map.
    pub here: usize,
    /// Those with a fix.
    pub answered: usize,
    /// Those with a right fix and an exact truth.
    pub right: usize,
    /// Those with an error within the stated 95 % radius.
    pub covered: usize,
    /// Photos on another map.
    pub elsewhere: usize,
    /// Those with a fix nevertheless.
    pub elsewhere_answered: usize,
}

impl Check {
    /// Counts more observations.
    pub fn add(&mut self, calibration: &Calibration, observations: &[&Observation]) {
        for observation in observations {
            let answered = is_answered(observation, calibration);
            if observation.elsewhere {
                self.elsewhere += 1;
                self.elsewhere_answered += usize::from(answered);
                continue;
            }
            self.here += 1;
            self.answered += usize::from(answered);
            if answered && observation.is_right() && !observation.real {
                self.right += 1;
                let covered = observation.answer.as_ref().is_some_and(|answer| {
                    answer.error_m() <= position::radius95_m(answer, &calibration.position)
                });
                self.covered += usize::from(covered);
            }
        }
    }
}

fn share(part: usize, whole: usize) -> f64 {
    part as f64 / whole.max(1) as f64
}
