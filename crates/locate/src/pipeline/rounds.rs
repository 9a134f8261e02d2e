//! One round of the search: queries under each hypothesis, candidates, full matching stage by stage.

use std::time::Instant;

use grimnet_photo::{Photo, View};
use rayon::prelude::*;

use crate::{
    context::{Context, TimeBudget},
    error::Result,
    outcome::elapsed_ms,
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
        cascade::{Cascade, Voters},
        hypotheses::Round,
    },
    trace::RoundTrace,
};

/// Number of candidates that are matched in parallel. It is a constant so that the answer does not depend on the number of threads.
const BATCH: usize = 4;

/// How far a round is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Depth {
    /// Through its first stage: the candidates that are most similar by descriptor.
    FirstStage,
    /// Through all of its stages.
    All,
}

/// A round in progress.
pub(crate) struct OpenRound {
    result: RoundResult,
    cascade: Cascade,
    stages_left: bool,
}

impl OpenRound {
    /// Finds the candidates under the hypotheses of `round`; none is matched yet.
    pub fn begin(
        context: Context<'_>,
        photo: &Photo,
        view: &View,
        prior: &Prior,
        round: Round,
    ) -> Result<Self> {
        let Round { hypotheses, about } = round;
        let level = hypotheses.first().map_or(0, |hypothesis| hypothesis.level);
        let side_px = side_px(context, &hypotheses);
        let Queries {
            features: queries,
            dense,
            mut time_ms,
        } = extract_queries(context, photo, view, &hypotheses, side_px)?;
        let mut trace = RoundTrace {
            level,
            ..RoundTrace::default()
        };
        let is_enough = |query: &QueryFeatures| query.points.len() >= MIN_KEYPOINTS;
        let mut candidates = Vec::new();
        if queries.iter().any(is_enough) {
            let since = Instant::now();
            candidates = by_descriptor(
                context.level(level),
                &queries,
                prior.near.as_ref(),
                context.options,
            )?;
            time_ms.search = elapsed_ms(since);
            trace.by_descriptor = distinct_tiles(&candidates);
        }
        Ok(Self {
            result: RoundResult {
                level,
                hypotheses,
                queries,
                dense,
                verified: Vec::new(),
                about,
                trace,
                time_ms,
            },
            cascade: Cascade::new(candidates),
            stages_left: true,
        })
    }

    /// Matches candidates in the order of the cascade until an answer is clear, the time is used up, or `depth` is reached. Whether the
    /// answer is clear.
    pub fn search(
        &mut self,
        context: Context<'_>,
        depth: Depth,
        budget: TimeBudget,
    ) -> Result<bool> {
        let since = Instant::now();
        let mut is_clear = false;
        while self.stages_left && !is_clear {
            let voters = Voters {
                level: context.level(self.result.level),
                queries: &self.result.queries,
                scratch: context.scratch,
                options: context.options,
            };
            self.stages_left = self.cascade.begin_stage(voters)?;
            is_clear = self.match_stage(context, budget)?;
            if depth == Depth::FirstStage || budget.is_spent() {
                break;
            }
        }
        self.result.time_ms.matching += elapsed_ms(since);
        Ok(is_clear)
    }

    /// Matches the candidates of the stage that was begun; whether the answer is clear.
    fn match_stage(&mut self, context: Context<'_>, budget: TimeBudget) -> Result<bool> {
        let options = context.options;
        let RoundResult {
            level,
            hypotheses,
            queries,
            verified,
            ..
        } = &mut self.result;
        let level = context.level(*level);
        loop {
            let batch = self.cascade.next_batch(BATCH);
            if batch.is_empty() {
                return Ok(false);
            }
            let more: Vec<VerifiedCandidate> = batch
                .par_iter()
                .map(|candidate| verify(context, level, hypotheses, queries, *candidate))
                .collect::<Result<_>>()?;
            verified.extend(more);
            if verified.len() < options.min_matched {
                continue;
            }
            let is_clear = best_candidate(verified, options)
                .is_some_and(|(best, runner_up)| is_clear(best, runner_up, options));
            if is_clear || budget.is_spent() {
                return Ok(is_clear);
            }
        }
    }

    /// The result, with what was searched so far.
    pub fn finish(self) -> RoundResult {
        let mut result = self.result;
        // The clock of the matching ran during the votes, too.
        result.time_ms.vote = self.cascade.vote_ms;
        result.time_ms.matching -= self.cascade.vote_ms;
        let rest: Vec<Candidate> = self.cascade.into_rest().collect();
        let matched: Vec<Candidate> = result.verified.iter().map(|v| v.candidate).collect();
        result.trace.matched = distinct_tiles(&matched);
        result.trace.by_vote = distinct_tiles(matched.iter().chain(&rest));
        result
    }
}
