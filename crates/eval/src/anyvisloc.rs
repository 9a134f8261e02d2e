//! Scenes of AnyVisLoc (Ye et al. 2026, CVPR Findings, arXiv 2503.10692) as their publishers lay them out.
//!
//! Written from the readme of github.com/UAV-AVL/Benchmark and from its reader (`avl_data.py`, `avl_utils.py`), and tested on folders of
//! that shape only: the data set itself may not be passed on.
//!
//! `Scene_01/` holds `L01_reference.json`, the maps that it names (`aerial_map.png`, `satellite_map.png`), their surface models, which are
//! not used here, and a `L01_0001.npz` a photo: the picture (`image`), the camera matrix (`K`), the camera's place (`xyz`) and attitude
//! (`euler_deg`: roll, pitch off straight down, yaw). Places are metres of a plane that belongs to the scene, x to the east, y to the
//! south, z above the mean ground, for the publishers keep the true coordinates back. That plane is put onto the equator at longitude 0
//! here: figures in metres are the same to a millimetre in a kilometre, longitudes and latitudes mean nothing.
//!
//! Two truths: the receiver's is the camera's place, which the publishers' own figures are about; the image centre's is where its line of
//! sight meets the mean ground, as their `view_center_anyvisloc` has it. Lens distortion is left in the pictures.

mod sample;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use grimnet_geo::{LonLat, destination_en_m};
use serde::Deserialize;

use crate::truth::TruthFrame;
use sample::Sample;

/// Where the scene's plane has its origin.
const ORIGIN: LonLat = LonLat {
    lon_deg: 0.0,
    lat_deg: 0.0,
};

/// The map that is taken where none is named.
const DEFAULT_REFERENCE: &str = "aerial";

/// A scene that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyVisLocScene {
    /// The map.
    pub map: PathBuf,
    /// Its corners, degrees: `[LL_LON, LL_LAT, UR_LON, UR_LAT]`.
    pub corners: [f64; 4],
    /// The truths; their photos are files in the folder that was given.
    pub frames: Vec<TruthFrame>,
    /// Samples that were left out, each with what is wrong with it.
    pub left_out: Vec<String>,
}

/// Why a scene cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum AnyVisLocError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The description of the maps cannot be understood.
    #[error("{path}: not the description of a scene's maps: {source}")]
    Reference {
        /// The file.
        path: PathBuf,
        /// What the reader said.
        source: serde_json::Error,
    },
    /// The description does not hold the map.
    #[error("{path}: describes no map {wanted}; it has {there}")]
    NoMap {
        /// The description.
        path: PathBuf,
        /// What was asked for.
        wanted: String,
        /// The maps that are described.
        there: String,
    },
    /// The map's size cannot be read.
    #[error("{path}: {source}")]
    Map {
        /// The map.
        path: PathBuf,
        /// What the reader said.
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
    /// Place of the upper left corner, metres.
    #[serde(default)]
    map_origin_local: [f64; 2],
}

/// Whether a folder looks like a scene.
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

/// The files of a folder, sorted; none of a folder that cannot be read.
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

/// Reads the scene in `folder` on `map`, one of its maps (by default the aerial one), and writes its photos into `photos`, with height,
/// attitude and angle of view in their metadata. Photos that are there already are not written again.
///
/// # Errors
/// The description is missing or does not hold the map; photos cannot be written. A sample that cannot be read is left out.
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
            Err(error) => left_out.push(format!("{}: {error}; left out", path.display())),
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

/// A place of the scene's plane, metres to the east and to the south.
fn lonlat(x_m: f64, y_m: f64) -> LonLat {
    destination_en_m(ORIGIN, x_m, -y_m)
}
