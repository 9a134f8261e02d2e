//! Paper mode: packs built by the publication's procedure (Remote Sens. 2026, 18(10), 1477).
//!
//! Tiles of 512 px at stride 256 (eq. 1) are cut from the map's own pixels, each is resized for the network and
//! described independently of the others, descriptors are not quantised, and the index is IVF256 with PQ64. What the paper
//! leaves open, and what was chosen, stands in the table "The paper and this program" of EVALUATION.md. Everything that
//! differs from the default mode is here: [`BuildOptions::paper`], and how the builder lays out and computes tiles ([`PaperTiles`]).

mod corner_error;
mod network_image;
mod tile_grid;
mod tiles;

pub(crate) use corner_error::corner_error_m;
pub use network_image::resize_for_network;
pub(crate) use tiles::PaperTiles;

use crate::index::Index;
use crate::mode::Mode;
use crate::options::BuildOptions;

/// The paper's index: IVF256, PQ64 (section 3.4.2). The paper does not give nprobe; faiss visits one list by default.
pub const PAPER_INDEX: Index = Index::IvfPq {
    nlist: 256,
    subquantisers: 64,
    nprobe: 32,
    rerank_factor: 0,
};

impl BuildOptions {
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
