//! How a pack is built.

use serde::{Deserialize, Serialize};

use crate::index::Index;
use crate::mode::Mode;

/// The ground resolutions of a pack.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Levels {
    /// Default mode: from the map's own resolution by factors of two until a tile is about a kilometre wide or covers the map. The
    /// finest is not finer than [`crate::FINEST_AUTO_GSD_M`]; a map of up to eight times [`crate::COARSEST_FINE_GSD_M`] is resampled to
    /// finer pixels than its own first. Paper mode: the map's own pixels.
    #[default]
    Auto,
    /// These resolutions, metres per pixel.
    Gsd(Vec<f64>),
}

/// How a pack is built. Every option changes the bytes of the result and is written into it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BuildOptions {
    /// Default or paper mode.
    pub mode: Mode,
    /// Ground resolutions.
    pub levels: Levels,
    /// Paper mode: side of the image that a tile is resized to, pixels, a multiple of 32 (paper: 320).
    pub resolution: u32,
    /// Approximate side of the coarsest tiles that [`Levels::Auto`] makes, metres.
    pub max_tile_m: f64,
    /// Whether normalisation statistics are recomputed on the map, without labels.
    pub adapt: bool,
    /// Keypoints below this probability are discarded.
    pub keypoint_threshold: f32,
    /// Radius of non-maximum suppression of keypoints, pixels.
    pub nms_radius_px: u32,
    /// Maximum number of keypoints of a cell (default mode) or of a tile (paper mode, at most 65,536).
    pub max_keypoints: u32,
    /// Search index of every level. `None`: chosen by mode and number of tiles. Default mode: exact up to about
    /// 100,000 tiles, then IVF-PQ re-ranked by full descriptors. Paper mode: [`crate::PAPER_INDEX`] if there are
    /// enough tiles to train it, else exact.
    pub index: Option<Index>,
    /// Default mode: fewest tiles of a level that gets an index of its keypoints, with which a photo is searched by its local
    /// descriptors, too. Among fewer tiles every likely one is compared anyway.
    #[serde(default = "keypoint_index_tiles")]
    pub keypoint_index_tiles: u32,
}

/// The default of [`BuildOptions::keypoint_index_tiles`].
fn keypoint_index_tiles() -> u32 {
    1000
}

impl BuildOptions {
    /// Options of the default mode. [`BuildOptions::paper`] has those of paper mode.
    pub fn standard() -> Self {
        Self {
            mode: Mode::Default,
            levels: Levels::Auto,
            resolution: 320,
            max_tile_m: 1000.0,
            adapt: false,
            keypoint_threshold: 0.005,
            nms_radius_px: 2,
            max_keypoints: 256,
            index: None,
            keypoint_index_tiles: keypoint_index_tiles(),
        }
    }
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self::standard()
    }
}
