//! The steps of a search, for those who evaluate it.

use serde::Serialize;

/// The steps of the search for one photo, by round of hypotheses.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Trace {
    /// The rounds in order.
    pub rounds: Vec<RoundTrace>,
}

/// The steps of one round of hypotheses. Tiles are indices in the level, best first, each once: at the rank of the hypothesis that
/// ranks it first.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RoundTrace {
    /// Level of the pack.
    pub level: usize,
    /// Tiles found by descriptor.
    pub by_descriptor: Vec<usize>,
    /// These, and tiles found by votes over the whole map, in the order in which they enter the search.
    pub by_search: Vec<usize>,
    /// The same tiles in the order of the cascade: first those that were matched, then the rest.
    pub by_vote: Vec<usize>,
    /// Tiles that were matched in full.
    pub matched: Vec<usize>,
}
