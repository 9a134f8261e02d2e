//! Finds the tiles whose descriptors are most similar to a query's.

mod exact;
pub(crate) mod hamming_code;
pub(crate) mod inverted_lists;
pub(crate) mod ivf_pq;
pub(crate) mod keypoint_index;
pub(crate) mod top_k;

pub use exact::Filter;
pub use keypoint_index::{KeypointIndex, Neighbour, Reach};
pub use top_k::Hit;

use crate::error::{PackError, Result};
use crate::index::Index;
use crate::level::Level;

/// Of so many tiles that a filter allows, or fewer, each is compared with the query.
const COMPARED_ONE_BY_ONE: usize = 20_000;

impl Level {
    /// The `k` tiles most similar to each of several queries (`q x global_dim`, unit vectors), best first, ties by
    /// tile index, with the index that the level was built with. Tiles for which `filter` returns `false` are left
    /// out; fewer than `k` may remain.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// Returns [`PackError::Dimension`] for queries of another length.
    pub fn search(
        &self,
        queries: &[f32],
        k: usize,
        filter: Option<Filter<'_>>,
    ) -> Result<Vec<Vec<Hit>>> {
        self.search_with(self.index(), queries, k, filter)
    }

    /// [`Level::search`] with another index: [`Index::Exact`], which every level has, or the level's own with another
    /// `nprobe` and `rerank_factor`.
    ///
    /// # Errors
    /// Returns [`PackError::Dimension`] for queries of another length, [`PackError::Index`] if the level does not have
    /// this index.
    pub fn search_with(
        &self,
        index: Index,
        queries: &[f32],
        k: usize,
        filter: Option<Filter<'_>>,
    ) -> Result<Vec<Vec<Hit>>> {
        let dim = self.global_dim();
        if queries.is_empty() || !queries.len().is_multiple_of(dim) {
            return Err(PackError::Dimension {
                expected: dim,
                found: queries.len(),
            });
        }
        let rows = self.globals();
        let Index::IvfPq {
            nlist,
            subquantisers,
            nprobe,
            rerank_factor,
        } = index
        else {
            return Ok(exact::search(rows, dim, queries, k, filter));
        };
        let lists = self
            .ivf_pq()
            .filter(|lists| lists.has_shape(nlist, subquantisers));
        let Some(lists) = lists else {
            return Err(PackError::Index(format!(
                "the level was built without IVF{nlist} PQ{subquantisers}"
            )));
        };
        if let Some(keep) = filter {
            let allowed: Vec<Hit> = (0..self.tile_count())
                .filter(|&tile| keep(tile))
                .map(|tile| Hit {
                    tile,
                    similarity: 0.0,
                })
                .collect();
            // Most of a few tiles would lie in lists that are not visited.
            if allowed.len() <= COMPARED_ONE_BY_ONE {
                let of_query = |query| exact::rerank(rows, query, &allowed, k);
                return Ok(queries.chunks_exact(dim).map(of_query).collect());
            }
        }
        let rerank_factor = rerank_factor as usize;
        let wanted = k.saturating_mul(rerank_factor.max(1));
        let mut found = lists.search(queries, wanted, nprobe as usize, filter);
        if rerank_factor > 0 {
            for (hits, query) in found.iter_mut().zip(queries.chunks_exact(dim)) {
                *hits = exact::rerank(rows, query, hits, k);
            }
        }
        Ok(found)
    }
}
