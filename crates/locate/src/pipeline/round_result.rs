//! The result of one round of hypotheses.

use std::sync::Arc;

use crate::{
    dense_query::DenseQuery, outcome::TimeMs, pipeline::verification::VerifiedCandidate,
    query_features::QueryFeatures, search::hypotheses::Hypothesis, trace::RoundTrace,
};

/// The hypotheses of a round with their queries, and the candidates that were matched in full.
#[derive(Debug)]
pub(crate) struct RoundResult {
    /// Level of the pack.
    pub level: usize,
    /// The hypotheses.
    pub hypotheses: Vec<Hypothesis>,
    /// The features of each hypothesis; rounds with the same queries share them.
    pub queries: Arc<[QueryFeatures]>,
    /// The network's output for a single hypothesis; shared likewise.
    pub dense: Option<Arc<DenseQuery>>,
    /// The candidates that were matched in full, in that order.
    pub verified: Vec<VerifiedCandidate>,
    /// What was assumed, for the answer's evidence.
    pub assumption: String,
    /// The steps of the search.
    pub trace: RoundTrace,
    /// Wall time by stage.
    pub time_ms: TimeMs,
}
