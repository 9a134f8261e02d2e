//! What was tried on the way to an answer, for those who measure the search.

use serde::Serialize;

use crate::candidates::Candidate;

/// What was tried for one photo, round by round of hypotheses.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Trace {
    /// The rounds, in the order in which they were tried.
    pub rounds: Vec<RoundTrace>,
}

/// What one round of hypotheses tried. Tiles are indices in the level, best first, each tile once: at the place of the hypothesis
/// that put it first.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RoundTrace {
    /// Level of the pack.
    pub level: usize,
    /// Tiles found by descriptor.
    pub by_descriptor: Vec<usize>,
    /// The same in the order of the cascade: as they were matched, then as they would have been.
    pub by_vote: Vec<usize>,
    /// Tiles that were matched in full.
    pub matched: Vec<usize>,
}

/// The tiles of candidates, in their order, each once.
pub(crate) fn tiles_of<'a>(candidates: impl IntoIterator<Item = &'a Candidate>) -> Vec<usize> {
    let mut seen = std::collections::HashSet::new();
    candidates
        .into_iter()
        .map(|candidate| candidate.tile)
        .filter(|&tile| seen.insert(tile))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vote::Peak;

    #[test]
    fn a_tile_counts_where_it_comes_first() {
        let candidate = |query, tile| Candidate {
            query,
            tile,
            similarity: 0.0,
            peak: Peak::default(),
        };
        let all = [(0, 7), (1, 7), (1, 3), (0, 3), (0, 9)].map(|(q, t)| candidate(q, t));
        assert_eq!(tiles_of(&all), [7, 3, 9]);
    }
}
