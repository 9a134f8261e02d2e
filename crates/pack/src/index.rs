//! The search index of a level.

use serde::{Deserialize, Serialize};

/// How the tile descriptors of a level are searched: what a pack is built with, holds, and searches with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
#[non_exhaustive]
pub enum Index {
    /// Every row is compared.
    Exact,
    /// Inverted lists with product-quantised residuals (IVFADC, Jégou, Douze and Schmid 2011).
    IvfPq {
        /// Number of lists.
        nlist: u32,
        /// Bytes per code; must divide the dimension of the tile descriptors.
        subquantisers: u32,
        /// Number of lists that a search visits.
        nprobe: u32,
        /// Number of candidates per result that are ranked again by their full descriptors; 0: none.
        rerank_factor: u32,
    },
}
