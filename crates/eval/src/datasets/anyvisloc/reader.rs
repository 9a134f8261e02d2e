//! Reads a scene of AnyVisLoc.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::files::{files_of, name_of, reference_file};
use super::plane::lonlat;
use super::sample::Sample;
use super::scene::{AnyVisLocError, AnyVisLocScene};

/// The map that is used unless another is requested.
const DEFAULT_REFERENCE: &str = "aerial";

/// `L01_reference.json`.
#[derive(Debug, Deserialize)]
struct References {
    modes: BTreeMap<String, Reference>,
}

/// One map of it.
#[derive(Debug, Clone, Deserialize)]
struct Reference {
    map_path: PathBuf,
    /// Metres per pixel along x and y.
    map_resolution: [f64; 2],
    /// Position of the upper left corner, metres.
    #[serde(default)]
    map_origin_local: [f64; 2],
}

/// Reads the scene in `folder` with `map`, one of its maps (by default the aerial one), and writes its photos into `photos`, with
/// height, attitude and field of view in their metadata. Photos that exist already are not written again.
///
/// # Errors
/// Returns an error if the description is missing or has no such map, or photos cannot be written. A sample that cannot be read is
/// skipped.
pub fn read(
    folder: &Path,
    map: Option<&Path>,
    photos: &Path,
) -> Result<AnyVisLocScene, AnyVisLocError> {
    let reference = reference(folder, map)?;
    let map = folder.join(&reference.map_path);
    let size_px = image::image_dimensions(&map).map_err(|source| AnyVisLocError::Map {
        path: map.clone(),
        source,
    })?;
    fs_err::create_dir_all(photos)?;
    let (mut frames, mut left_out) = (Vec::new(), Vec::new());
    let mut sources: Vec<PathBuf> = reference_file(folder).into_iter().collect();
    for path in files_of(folder) {
        if path.extension().is_none_or(|e| e != "npz") {
            continue;
        }
        match Sample::open(&path).and_then(|sample| sample.frame(&path, photos)) {
            Ok(frame) => frames.push(frame),
            Err(error) => left_out.push(format!("{}: {error}; skipped", path.display())),
        }
        sources.push(path);
    }
    Ok(AnyVisLocScene {
        map,
        corners: reference.corners(size_px),
        frames,
        sources,
        left_out,
    })
}

fn reference(folder: &Path, map: Option<&Path>) -> Result<Reference, AnyVisLocError> {
    let path = reference_file(folder).unwrap_or_else(|| folder.join("L??_reference.json"));
    let text = fs_err::read_to_string(&path)?;
    let all: References =
        serde_json::from_str(&text).map_err(|source| AnyVisLocError::Reference {
            path: path.clone(),
            source,
        })?;
    let found = match map {
        None => all.modes.get(DEFAULT_REFERENCE),
        Some(map) => all
            .modes
            .values()
            .find(|r| r.map_path.file_name() == map.file_name()),
    };
    found.cloned().ok_or_else(|| AnyVisLocError::NoMap {
        path,
        wanted: map.map_or_else(|| DEFAULT_REFERENCE.to_owned(), name_of),
        there: all
            .modes
            .iter()
            .map(|(name, r)| format!("{} ({name})", r.map_path.display()))
            .collect::<Vec<_>>()
            .join(", "),
    })
}

impl Reference {
    fn corners(&self, (width, height): (u32, u32)) -> [f64; 4] {
        let [left, top] = self.map_origin_local;
        let right = left + f64::from(width) * self.map_resolution[0];
        let bottom = top + f64::from(height) * self.map_resolution[1];
        let (lower_left, upper_right) = (lonlat(left, bottom), lonlat(right, top));
        [
            lower_left.lon_deg,
            lower_left.lat_deg,
            upper_right.lon_deg,
            upper_right.lat_deg,
        ]
    }
}
