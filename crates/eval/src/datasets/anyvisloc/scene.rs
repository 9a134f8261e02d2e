//! A scene of AnyVisLoc as read, and why one cannot be read.

use std::path::PathBuf;

use crate::datasets::truth::TruthFrame;

/// A scene as read from its folder.
#[derive(Debug, Clone, PartialEq)]
pub struct AnyVisLocScene {
    /// The map.
    pub map: PathBuf,
    /// Its corners, degrees: `[LL_LON, LL_LAT, UR_LON, UR_LAT]`.
    pub corners: [f64; 4],
    /// The truths; their photos are files in the photo folder.
    pub frames: Vec<TruthFrame>,
    /// The description of the maps, and the samples that the photos were taken from.
    pub sources: Vec<PathBuf>,
    /// Messages about samples that were skipped, each with the reason.
    pub left_out: Vec<String>,
}

/// Why a scene cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnyVisLocError {
    /// This build has no reader of `.npz` files.
    #[error(
        "{folder}: a scene of AnyVisLoc, whose photos are .npz archives, which this build cannot read"
    )]
    NotBuilt {
        /// The scene.
        folder: PathBuf,
    },
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
