//! Each photo is localised on its own map and on another scene's, with the gates nearly open.

use std::path::Path;

use grimnet_geo::{LonLat, MapOptions, offset_en_m, open_map};
use grimnet_locate::{Gates, Localizer, Options, Outcome};
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Pack, build};

use super::observation::{Answer, Observation};
use super::scene::{Scene, Shot};

/// Why a trial cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The map cannot be read.
    #[error(transparent)]
    Map(#[from] grimnet_geo::GeoError),
    /// The pack cannot be built.
    #[error(transparent)]
    Pack(#[from] grimnet_pack::PackError),
    /// The localiser refuses.
    #[error(transparent)]
    Locate(#[from] grimnet_locate::LocateError),
}

/// Every one in so many photos is also looked for without its heading, which takes a dozen times as long.
const UNKNOWN_HEADING_EVERY: usize = 6;

/// Fewer inliers than this are never given as a fix, so nothing need be known of them.
const MIN_INLIERS: usize = 6;

/// Settings under which answers are observed: shapes are checked as always, support is not, and the map is exact.
fn observing() -> Options {
    Options {
        gates: Some(Gates {
            min_inliers: MIN_INLIERS,
            min_places: 0,
            min_margin: 0.0,
            by_confidence: false,
            ..Gates::default()
        }),
        map_error_m: 0.0,
        ..Options::default()
    }
}

/// Localises the photos of all scenes, each scene's own and the next scene's on its map. `on_photo` is called after each.
///
/// # Errors
/// A map, pack or photo is refused.
pub fn observe(
    model: &Model,
    scenes: &[Scene],
    folder: &Path,
    on_photo: &mut dyn FnMut(),
) -> Result<Vec<Observation>, TrialError> {
    let mut observations = Vec::new();
    for (index, scene) in scenes.iter().enumerate() {
        let localizer = localizer(model, scene, &folder.join(format!("scene_{index}.grim")))?;
        let other = (index + 1) % scenes.len();
        for (from, elsewhere) in [(index, false), (other, true)] {
            if elsewhere && other == index {
                continue;
            }
            for (number, shot) in scenes[from].shots.iter().enumerate() {
                let blind = number % UNKNOWN_HEADING_EVERY == 0;
                for heading_known in [true, false].into_iter().take(1 + usize::from(blind)) {
                    let answer = answer(&localizer, shot, heading_known)?;
                    observations.push(Observation {
                        // By the photo, so that a photo is on one side only.
                        scene: from,
                        elsewhere,
                        heading_known,
                        answer,
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

/// The localiser of a scene's map, whose pack is written to `pack`, under the settings of an observation.
///
/// # Errors
/// The map or the pack is refused.
pub fn localizer(model: &Model, scene: &Scene, pack: &Path) -> Result<Localizer, TrialError> {
    let map = open_map(&scene.map, &MapOptions::default())?;
    build(
        map.as_ref(),
        model,
        &BuildOptions::standard(),
        pack,
        &mut |_| {},
    )?;
    Ok(Localizer::new(model.clone(), Pack::open(pack)?)?.with_options(observing()))
}

/// What comes of a photo.
///
/// # Errors
/// The localiser refuses.
pub fn answer(
    localizer: &Localizer,
    shot: &Shot,
    heading_known: bool,
) -> Result<Option<Answer>, TrialError> {
    let prior = if heading_known {
        shot.prior
    } else {
        shot.prior.with_unknown_heading()
    };
    Ok(match localizer.locate(&shot.photo, &prior)? {
        Outcome::Fix(fix) => {
            let position = LonLat {
                lon_deg: fix.lon_deg,
                lat_deg: fix.lat_deg,
            };
            let (error_east_m, error_north_m) = offset_en_m(shot.truth, position);
            Some(Answer {
                error_east_m,
                error_north_m,
                level_gsd_m: fix.tile.gsd_m,
                support: fix.support,
            })
        }
        Outcome::NoFix(_) => None,
    })
}
