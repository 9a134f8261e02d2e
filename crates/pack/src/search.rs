//! Finding the tiles whose descriptors are most similar to a query's.

mod exact;
pub mod ivf_pq;
mod k_means;
pub(crate) mod top_k;

pub use exact::Filter;
pub use top_k::Hit;

use crate::error::{PackError, Result};
use crate::level::Level;
use crate::manifest::IndexManifest;

/// How to search the tile descriptors of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Index {
    /// Every row is compared.
    Exact,
    /// Inverted lists with product-quantised residuals; the pack must have been built with them.
    IvfPq {
        /// Lists visited. The paper does not give it; faiss visits one unless told.
        nprobe: usize,
        /// This many candidates per answer are ranked again by full vectors; 0: none (as the paper).
        rerank_factor: usize,
    },
}

impl Index {
    /// The index that a level was built with.
    pub fn of(level: &Level) -> Self {
        match level.manifest().index {
            IndexManifest::Exact { .. } => Self::Exact,
            IndexManifest::IvfPq {
                nprobe,
                rerank_factor,
                ..
            } => Self::IvfPq {
                nprobe: nprobe as usize,
                rerank_factor: rerank_factor as usize,
            },
        }
    }

    /// The `k` tiles of `level` most similar to each of several queries (`q x global_dim`, unit vectors), best first,
    /// ties by tile index. Tiles for which `filter` says no are left out; fewer than `k` may remain.
    ///
    /// The answer does not depend on the number of threads.
    ///
    /// # Errors
    /// [`PackError::Dimension`] for queries of another length, [`PackError::Index`] where the level has no IVF-PQ
    /// index.
    pub fn search(
        &self,
        level: &Level,
        queries: &[f32],
        k: usize,
        filter: Option<Filter<'_>>,
    ) -> Result<Vec<Vec<Hit>>> {
        let dim = level.global_dim();
        if queries.is_empty() || !queries.len().is_multiple_of(dim) {
            return Err(PackError::Dimension {
                expected: dim,
                found: queries.len(),
            });
        }
        let (rows, scales) = (level.globals(), level.global_scales());
        match *self {
            Self::Exact => Ok(exact::search(rows, scales, dim, queries, k, filter)),
            Self::IvfPq {
                nprobe,
                rerank_factor,
            } => {
                let Some(index) = level.ivf_pq() else {
                    return Err(PackError::Index("the pack was built without one".into()));
                };
                let wanted = k.saturating_mul(rerank_factor.max(1));
                let mut found = index.search(queries, wanted, nprobe, filter);
                if rerank_factor > 0 {
                    for (hits, query) in found.iter_mut().zip(queries.chunks_exact(dim)) {
                        *hits = exact::rerank(rows, scales, query, hits, k);
                    }
                }
                Ok(found)
            }
        }
    }
}

impl Level {
    /// [`Index::search`] with the index that the level was built with.
    ///
    /// # Errors
    /// As [`Index::search`].
    pub fn search(
        &self,
        queries: &[f32],
        k: usize,
        filter: Option<Filter<'_>>,
    ) -> Result<Vec<Vec<Hit>>> {
        Index::of(self).search(self, queries, k, filter)
    }
}
