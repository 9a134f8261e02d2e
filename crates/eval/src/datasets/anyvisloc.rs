//! Reads scenes of AnyVisLoc (Ye et al. 2026, CVPR Findings, arXiv 2503.10692) in their published layout.
//!
//! Written from the readme of github.com/UAV-AVL/Benchmark and from its reader (`avl_data.py`, `avl_utils.py`), and tested on folders
//! of that layout only: the data set itself may not be redistributed.
//!
//! `Scene_01/` holds `L01_reference.json`, the maps that it names (`aerial_map.png`, `satellite_map.png`), their surface models, which
//! are not used here, and one `L01_0001.npz` per photo: the picture (`image`), the camera matrix (`K`), the camera's position (`xyz`)
//! and attitude (`euler_deg`: roll, pitch off straight down, yaw). Positions are metres in a local plane of the scene, x to the east, y
//! to the south, z above the mean ground; the publishers withhold the true coordinates. The plane is placed at longitude and latitude
//! zero here: distances in metres agree to a millimetre in a kilometre; longitudes and latitudes have no meaning.
//!
//! Two truths: the receiver's is the camera's position, which the publishers' own figures refer to; the image centre's is where the
//! line of sight meets the mean ground, as in their `view_center_anyvisloc`. Lens distortion is not removed from the pictures.

mod plane;
mod sample;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::datasets::truth::TruthFrame;
use plane::lonlat;
use sample::Sample;

/// The map that is used unless another is requested.
const DEFAULT_REFERENCE: &str = "aerial";

/// A scene as read from its folder.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyVisLocScene {
    /// The map.
    pub map: PathBuf,
    /// Its corners, degrees: `[LL_LON, LL_LAT, UR_LON, UR_LAT]`.
    pub corners: [f64; 4],
    /// The truths; their photos are files in the photo folder.
    pub frames: Vec<TruthFrame>,
    /// Messages about samples that were skipped, each with the reason.
    pub left_out: Vec<String>,
}

/// Why a scene cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnyVisLocError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The description of the maps cannot be parsed.
    #[error("{path}: not a description of a scene's maps: {source}")]
    Reference {
        /// The file.
        path: PathBuf,
        /// The reader's error.
        source: serde_json::Error,
    },
    /// The description does not hold the map.
    #[error("{path}: no map {wanted}; it describes {there}")]
    NoMap {
        /// The description.
        path: PathBuf,
        /// The requested map.
        wanted: String,
        /// The maps that are described.
        there: String,
    },
    /// The map's size cannot be read.
    #[error("{path}: {source}")]
    Map {
        /// The map.
        path: PathBuf,
        /// The reader's error.
        source: image::ImageError,
    },
}

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

/// Returns whether a folder has the files of a scene.
#[must_use]
pub fn is_scene(folder: &Path) -> bool {
    reference_file(folder).is_some()
}

/// `L??_reference.json`.
fn reference_file(folder: &Path) -> Option<PathBuf> {
    files_of(folder)
        .into_iter()
        .find(|path| name_of(path).starts_with('L') && name_of(path).ends_with("_reference.json"))
}

/// The files of a folder, sorted; empty if the folder cannot be read.
fn files_of(folder: &Path) -> Vec<PathBuf> {
    let entries = fs_err::read_dir(folder).into_iter().flatten();
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    files
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
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
    for path in files_of(folder) {
        if path.extension().is_none_or(|e| e != "npz") {
            continue;
        }
        match Sample::open(&path).and_then(|sample| sample.frame(&path, photos)) {
            Ok(frame) => frames.push(frame),
            Err(error) => left_out.push(format!("{}: {error}; skipped", path.display())),
        }
    }
    Ok(AnyVisLocScene {
        map,
        corners: reference.corners(size_px),
        frames,
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
