//! Localises each photo on its own map and on another scene's, with the gates nearly open.

use std::cell::OnceCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use grimnet_locate::{Gates, Localizer, Options};
use grimnet_net::Model;
use grimnet_pack::{BuildLimits, BuildOptions, Pack, build_interruptible};

use super::PhotoCount;
use super::observation::{Answer, Observation};
use super::observer::{ObserveError, Observer};
use crate::evaluation::{TrialError, evaluate_one};
use crate::scene::{HeadingMode, Scene, Shot};

/// One in so many photos is also localised without its heading, which takes a dozen times as long.
const UNKNOWN_HEADING_EVERY: usize = 6;

/// Options of observations: the gates of a calibrated model without its confidence (of two places that look alike neither is an answer
/// even so), and an exact map.
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

/// Localises the photos of all scenes: each scene's own and the next scene's on its map.
///
/// # Errors
/// A map, pack or photo is refused, an observation cannot be kept, or the run was stopped.
pub fn observe(
    model: &Model,
    scenes: &[Scene],
    folder: &Path,
    observer: &mut Observer<'_>,
) -> Result<(), ObserveError> {
    for (index, scene) in scenes.iter().enumerate() {
        let localizer =
            SceneLocalizer::new(model, scene, pack_path(folder, index), observer.stop());
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
                    observer.next(|| {
                        Ok(Observation {
                            // The scene of the photo, so that a photo is on one side of a check only.
                            scene: from,
                            elsewhere,
                            heading_known: heading == HeadingMode::Known,
                            real: false,
                            answer: answer(localizer.get()?, shot, heading)?,
                        })
                    })?;
                }
            }
        }
    }
    Ok(())
}

/// How many photos [`observe`] will localise.
#[must_use]
pub fn count(scenes: &[Scene]) -> PhotoCount {
    let shots = scenes.iter().map(|scene| {
        let shots = scene.shots.len();
        shots + shots.div_ceil(UNKNOWN_HEADING_EVERY)
    });
    let here = shots.sum();
    PhotoCount {
        here,
        elsewhere: if scenes.len() > 1 { here } else { 0 },
    }
}

/// The localiser of a scene's map under the settings of an observation; the pack is written to `pack`, unless it is there already.
/// Its build ends when `stop` is set.
///
/// # Errors
/// The map or the pack is refused, or the build was stopped.
pub(crate) fn localizer(
    model: &Model,
    scene: &Scene,
    pack: &Path,
    stop: &AtomicBool,
) -> Result<Localizer, ObserveError> {
    build_interruptible(
        scene.map.as_ref(),
        model,
        &BuildOptions::standard(),
        &BuildLimits::default(),
        pack,
        &mut |_| {
            if stop.load(Ordering::Relaxed) {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        },
    )?;
    Ok(Localizer::new(model.clone(), Pack::open(pack)?)?.with_options(observing()))
}

/// The [`localizer`] of a scene, made when the first photo needs it: not where an earlier
/// run made all observations.
pub(crate) struct SceneLocalizer<'a> {
    model: &'a Model,
    scene: &'a Scene,
    pack: PathBuf,
    stop: &'a AtomicBool,
    made: OnceCell<Localizer>,
}

impl<'a> SceneLocalizer<'a> {
    /// What [`localizer`] gives.
    #[must_use]
    pub fn new(model: &'a Model, scene: &'a Scene, pack: PathBuf, stop: &'a AtomicBool) -> Self {
        Self {
            model,
            scene,
            pack,
            stop,
            made: OnceCell::new(),
        }
    }

    /// The localiser.
    ///
    /// # Errors
    /// As [`localizer`].
    pub fn get(&self) -> Result<&Localizer, ObserveError> {
        if let Some(localizer) = self.made.get() {
            return Ok(localizer);
        }
        let localizer = localizer(self.model, self.scene, &self.pack, self.stop)?;
        Ok(self.made.get_or_init(|| localizer))
    }
}

/// The answer to one photo; `None` without a fix.
///
/// # Errors
/// The localiser refuses the photo.
pub(crate) fn answer(
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
