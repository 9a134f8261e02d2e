//! Localises each photo on its own map and on another scene's, with the gates nearly open.

use std::path::{Path, PathBuf};

use grimnet_locate::{Gates, Localizer, LocateError, Options};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Pack, PackError, build};

use super::observation::{Answer, Observation};
use crate::evaluation::{TrialError, evaluate_one};
use crate::scene::{HeadingMode, Scene, Shot};

/// Why observations cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ObserveError {
    /// The pack cannot be built.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The localiser refuses the model or the pack.
    #[error(transparent)]
    Locate(Box<LocateError>),
    /// A photo cannot be localised.
    #[error(transparent)]
    Trial(#[from] TrialError),
}

impl From<LocateError> for ObserveError {
    fn from(error: LocateError) -> Self {
        Self::Locate(Box::new(error))
    }
}

/// One in so many photos is also localised without its heading, which takes a dozen times as long.
const UNKNOWN_HEADING_EVERY: usize = 6;

/// Options of observations: the gates of a calibrated model without its confidence, and an exact map.
fn observing() -> Options {
    Options {
        gates: Some(Gates {
            by_confidence: false,
            ..Gates::default().with_calibration()
        }),
        map_error_m: 0.0,
        ..Options::default()
    }
}

/// The pack of scene `number` of a calibration: a scene that is observed twice has one.
#[must_use]
pub fn pack_path(folder: &Path, number: usize) -> PathBuf {
    folder.join(format!("scene_{number}.grim"))
}

/// Localises the photos of all scenes: each scene's own and the next scene's on its map. `on_photo` is called after each.
///
/// # Errors
/// A map, pack or photo is refused.
pub fn observe(
    model: &Model,
    scenes: &[Scene],
    folder: &Path,
    on_photo: &mut dyn FnMut(),
) -> Result<Vec<Observation>, ObserveError> {
    let mut observations = Vec::new();
    for (index, scene) in scenes.iter().enumerate() {
        let localizer = localizer(model, scene, &pack_path(folder, index))?;
        let other = (index + 1) % scenes.len();
        for (from, elsewhere) in [(index, false), (other, true)] {
            if elsewhere && other == index {
                continue;
            }
            for (number, shot) in scenes[from].shots.iter().enumerate() {
                let also_unknown = number % UNKNOWN_HEADING_EVERY == 0;
                for heading in [HeadingMode::Known, HeadingMode::Unknown]
                    .into_iter()
                    .take(1 + usize::from(also_unknown))
                {
                    observations.push(Observation {
                        // The scene of the photo, so that a photo is on one side of a check only.
                        scene: from,
                        elsewhere,
                        heading_known: heading == HeadingMode::Known,
                        real: false,
                        answer: answer(&localizer, shot, heading)?,
                    });
                    on_photo();
                }
            }
        }
    }
    Ok(observations)
}

/// How many photos [`observe`] will localise.
#[must_use]
pub fn count(scenes: &[Scene]) -> usize {
    let places = scenes.len().min(2);
    let shots = scenes.iter().map(|scene| {
        let shots = scene.shots.len();
        shots + shots.div_ceil(UNKNOWN_HEADING_EVERY)
    });
    shots.sum::<usize>() * places
}

/// The localiser of a scene's map under the settings of an observation; the pack is written to `pack`, unless it is there already.
///
/// # Errors
/// The map or the pack is refused.
pub fn localizer(model: &Model, scene: &Scene, pack: &Path) -> Result<Localizer, ObserveError> {
    build(
        scene.map.as_ref(),
        model,
        &BuildOptions::standard(),
        pack,
        &mut |_| {},
    )?;
    Ok(Localizer::new(model.clone(), Pack::open(pack)?)?.with_options(observing()))
}

/// The answer to one photo; `None` without a fix.
///
/// # Errors
/// The localiser refuses the photo.
pub fn answer(
    localizer: &Localizer,
    shot: &Shot,
    heading: HeadingMode,
) -> Result<Option<Answer>, TrialError> {
    let trial = evaluate_one(localizer, shot, heading);
    let outcome = trial.found?.outcome;
    let fix = outcome.as_ref().and_then(|outcome| outcome.fix());
    let error = trial.frame.error_east_m.zip(trial.frame.error_north_m);
    Ok(fix
        .zip(error)
        .map(|(fix, (error_east_m, error_north_m))| Answer {
            error_east_m,
            error_north_m,
            level_gsd_m: fix.tile.gsd_m,
            support: fix.support,
        }))
}
