//! How a pack is built.

use serde::{Deserialize, Serialize};

/// The paper's recipe to the letter, or what serves a user best.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Features once per ground cell, tile descriptors summed from cells.
    #[default]
    Default,
    /// Independent tiles of 512 px at stride 256, each resized for the network.
    Paper,
}

/// Which ground resolutions the pack holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Levels {
    /// Default mode: from the map's own resolution (not finer than 0.15 m) by factors of two until a tile is
    /// about a kilometre or covers the map. Paper mode: the map's own resolution alone.
    #[default]
    Auto,
    /// These, metres a pixel.
    Gsd(Vec<f64>),
}

/// Which index is made for each level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IndexChoice {
    /// Default mode: exact up to about 100,000 tiles, then IVF-PQ re-ranked by full vectors.
    /// Paper mode: IVF256 + PQ64 where the tiles suffice to train it, else exact.
    #[default]
    Auto,
    /// Every row is compared.
    Exact,
    /// Inverted lists with product quantisation, or an error where they cannot be trained.
    IvfPq {
        /// Number of lists.
        nlist: u32,
        /// Bytes a vector; must divide the descriptor's dimension.
        subquantisers: u32,
        /// Lists visited by default.
        nprobe: u32,
        /// Candidates per answer that are ranked again by full vectors; 0: none.
        rerank_factor: u32,
    },
}

/// The paper's index: IVF256, PQ64 (section 3.2). It does not give nprobe; faiss visits one list unless told.
pub const PAPER_INDEX: IndexChoice = IndexChoice::IvfPq {
    nlist: 256,
    subquantisers: 64,
    nprobe: 32,
    rerank_factor: 0,
};

/// How a pack is built. Everything here changes the bytes of the result and is written into it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BuildOptions {
    /// Recipe.
    pub mode: Mode,
    /// Ground resolutions.
    pub levels: Levels,
    /// Paper mode: side of the picture that a tile is resized to, pixels, a multiple of 32 (paper: 320).
    pub resolution: u32,
    /// Side of the coarsest tiles that [`Levels::Auto`] makes, metres, roughly.
    pub max_tile_m: f64,
    /// Whether normalisation statistics are taken anew from the map, without labels.
    pub adapt: bool,
    /// Keypoints below this probability are not kept.
    pub keypoint_threshold: f32,
    /// Keypoints nearer to a stronger one than this are not kept, pixels.
    pub nms_radius_px: u32,
    /// Most keypoints of a cell (default mode) or of a tile (paper mode).
    pub max_keypoints: u32,
    /// Index.
    pub index: IndexChoice,
}

impl BuildOptions {
    /// Options of the default mode.
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
            index: IndexChoice::Auto,
        }
    }

    /// The paper's options: tiles of 512 px resized to 320 x 320, threshold 0.015, 1024 keypoints.
    pub fn paper() -> Self {
        Self {
            mode: Mode::Paper,
            keypoint_threshold: 0.015,
            max_keypoints: 1024,
            ..Self::standard()
        }
    }
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self::standard()
    }
}
