//! The scenes that experiments run on: data sets, or procedural worlds.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use grimnet_eval::datasets::{DataSet, DataSetRequest};
use grimnet_eval::scene::Scene;
use grimnet_experiments::world_flight::WorldFlight;
use grimnet_photo::pictures::file_name;

use crate::arguments::{Arguments, WORLDS, WorldOptions};

/// The flights over the procedural worlds.
pub fn flights(options: &WorldOptions) -> Vec<WorldFlight> {
    (options.world_seed..)
        .zip(WORLDS)
        .take(options.worlds)
        .map(|(seed, (name, urban))| {
            WorldFlight::over(name, seed, options.world_size, urban, options.world_photos)
        })
        .collect()
}

/// The procedural worlds in words.
pub fn worlds_in_words(options: &WorldOptions) -> String {
    format!(
        "{} procedural worlds of {:.0} m, seeds from {}, {} photos each",
        options.worlds, options.world_size, options.world_seed, options.world_photos
    )
}

/// The data set, each data set of a folder of such, or the procedural worlds; what is drawn or unpacked is written into `scratch`.
///
/// # Errors
/// Unreadable data, or a map for a data set that is not there.
pub fn scenes(arguments: &Arguments, scratch: &Path) -> Result<Vec<Scene>> {
    let Some(folder) = &arguments.folder else {
        return flights(&arguments.worlds)
            .iter()
            .map(|flight| Ok(flight.make(scratch)?))
            .collect();
    };
    let folders = DataSet::scenes(folder)?;
    let unknown = arguments
        .scene_maps
        .iter()
        .find(|(scene, _)| !folders.iter().any(|f| file_name(f) == *scene));
    if let Some((scene, _)) = unknown {
        let names: Vec<String> = folders.iter().map(|f| file_name(f)).collect();
        bail!(
            "--scene-map {scene}=...: {} has no such data set; it has {}",
            folder.display(),
            names.join(", ")
        );
    }
    folders
        .iter()
        .map(|folder| read_scene(folder, arguments, scratch))
        .collect()
}

/// The maps that the command line names.
pub fn named_maps(arguments: &Arguments) -> Vec<PathBuf> {
    let of_scenes = arguments.scene_maps.iter().map(|(_, map)| map.clone());
    arguments.map.iter().cloned().chain(of_scenes).collect()
}

/// The scene of one data set, named by its folder, with its photos decoded.
fn read_scene(folder: &Path, arguments: &Arguments, scratch: &Path) -> Result<Scene> {
    let name = file_name(folder);
    let own = arguments
        .scene_maps
        .iter()
        .find(|(scene, _)| *scene == name);
    let map = own.map(|(_, map)| map).or(arguments.map.as_ref());
    let mut data = DataSet::find(&DataSetRequest {
        folder,
        map: map.map(PathBuf::as_path),
        map_options: arguments.place.options(),
        scratch: &scratch.join("photos").join(&name),
        photo_limits: arguments.limits.photo(),
    })?;
    for (frame, _) in &mut data.frames {
        frame.footprint_width_m = arguments.footprint_width.or(frame.footprint_width_m);
    }
    let map = data.open_map()?;
    Ok(Scene {
        name,
        ..data.into_scene(map)?.decoded()?
    })
}
