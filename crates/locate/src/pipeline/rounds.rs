//! One round of the search: queries under each hypothesis, candidates, full matching.

use std::time::Instant;

use grimnet_photo::{Photo, View};
use rayon::prelude::*;

use crate::{
    context::{Context, TimeBudget},
    error::Result,
    outcome::{TimeMs, elapsed_ms},
    pipeline::{
        queries::{Queries, extract_queries, side_px},
        ranking::{best_candidate, is_clear},
        round_result::RoundResult,
        verification::{VerifiedCandidate, verify},
    },
    prior::Prior,
    query_features::{MIN_KEYPOINTS, QueryFeatures},
    search::{
        candidates::{Candidate, by_descriptor, distinct_tiles},
        cascade::Cascade,
        hypotheses::{Hypothesis, Round},
    },
    trace::RoundTrace,
};

/// Number of candidates that are matched in parallel. It is a constant so that the answer does not depend on the number of threads.
const BATCH: usize = 4;

/// Searches under the hypotheses of `round`.
pub(crate) fn run_round(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    round: Round,
    budget: TimeBudget,
) -> Result<RoundResult> {
    let Round { hypotheses, about } = round;
    let level = hypotheses.first().map_or(0, |hypothesis| hypothesis.level);
    let side_px = side_px(context, &hypotheses);
    let Queries {
        features: queries,
        dense,
        mut time_ms,
    } = extract_queries(context, photo, view, &hypotheses, side_px)?;
    let mut verified = Vec::new();
    let mut trace = RoundTrace {
        level,
        ..RoundTrace::default()
    };
    let is_enough = |query: &QueryFeatures| query.points.len() >= MIN_KEYPOINTS;
    if queries.iter().any(is_enough) {
        let since = Instant::now();
        let candidates = by_descriptor(
            context.level(level),
            &queries,
            prior.near.as_ref(),
            context.options,
        )?;
        time_ms.search = elapsed_ms(since);
        trace.by_descriptor = distinct_tiles(&candidates);
        let matched = match_candidates(context, &hypotheses, &queries, candidates, budget)?;
        time_ms += matched.time_ms;
        let entered: Vec<Candidate> = matched.verified.iter().map(|v| v.candidate).collect();
        trace.matched = distinct_tiles(&entered);
        trace.by_vote = distinct_tiles(entered.iter().chain(&matched.rest));
        verified = matched.verified;
    }
    Ok(RoundResult {
        level,
        hypotheses,
        queries,
        dense,
        verified,
        about,
        trace,
        time_ms,
    })
}

/// Candidates that were matched in full, and the rest.
struct MatchedCandidates {
    verified: Vec<VerifiedCandidate>,
    rest: Vec<Candidate>,
    time_ms: TimeMs,
}

/// Matches candidates in the order of the cascade until an answer is clear or the time is used up.
fn match_candidates(
    context: Context<'_>,
    hypotheses: &[Hypothesis],
    queries: &[QueryFeatures],
    candidates: Vec<Candidate>,
    budget: TimeBudget,
) -> Result<MatchedCandidates> {
    let options = context.options;
    let level = context.level(hypotheses.first().map_or(0, |hypothesis| hypothesis.level));
    let since = Instant::now();
    let mut verified: Vec<VerifiedCandidate> = Vec::new();
    let mut cascade = Cascade::new(level, queries, candidates, context.scratch, options);
    loop {
        let batch = cascade.next_batch(BATCH)?;
        if batch.is_empty() {
            break;
        }
        let more: Vec<VerifiedCandidate> = batch
            .par_iter()
            .map(|candidate| verify(context, level, hypotheses, queries, *candidate))
            .collect::<Result<_>>()?;
        verified.extend(more);
        let is_enough = verified.len() >= options.min_matched;
        if is_enough
            && (budget.is_spent()
                || best_candidate(&verified, options)
                    .is_some_and(|(best, runner_up)| is_clear(best, runner_up, options)))
        {
            break;
        }
    }
    let vote_ms = cascade.vote_ms;
    Ok(MatchedCandidates {
        verified,
        rest: cascade.into_rest().collect(),
        time_ms: TimeMs {
            vote: vote_ms,
            matching: elapsed_ms(since) - vote_ms,
            ..TimeMs::default()
        },
    })
}
