//! The search index of a level.

use serde::{Deserialize, Serialize};

use crate::error::{PackError, Result};

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

impl Index {
    /// The same lists and codes, searched with other settings.
    ///
    /// # Errors
    /// Returns [`PackError::Index`] for [`Index::Exact`], which has no lists to visit.
    pub fn with_probes(self, nprobe: u32, rerank_factor: u32) -> Result<Self> {
        match self {
            Self::Exact => Err(PackError::Index(
                "the level was built without an IVF-PQ index".into(),
            )),
            Self::IvfPq {
                nlist,
                subquantisers,
                ..
            } => Ok(Self::IvfPq {
                nlist,
                subquantisers,
                nprobe,
                rerank_factor,
            }),
        }
    }
}
