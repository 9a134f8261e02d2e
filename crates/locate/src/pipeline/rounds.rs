//! One round of the search: queries under each hypothesis, candidates that enter stage by stage, full matching.

use std::time::Instant;

use grimnet_geo::LevelPx;
use grimnet_pack::Level;
use grimnet_photo::{Photo, View};
use rayon::prelude::*;

use crate::{
    context::{Context, TimeBudget},
    error::Result,
    options::{MapVoteOptions, Options},
    outcome::{TimeMs, elapsed_ms},
    pipeline::{
        queries::{Queries, QueryKey, extract_queries, side_px},
        ranking::{SAME_POSITION_PX, clear_candidate},
        round_result::RoundResult,
        tile_frame::{TileFrame, TilePx},
        verification::{VerifiedCandidate, verify},
    },
    prior::{Near, Prior},
    query_features::{MIN_KEYPOINTS, QueryFeatures},
    search::{
        candidates::{Candidate, by_descriptor, distinct_tiles, join_map_votes},
        cascade::{Cascade, VoteContext},
        hypotheses::Round,
    },
    trace::RoundTrace,
};

/// Number of candidates that are matched in parallel. It is a constant so that the answer does not depend on the number of threads.
pub(crate) const BATCH: usize = 4;

/// A candidate whose votes are for a position at least so far from the answer's is of another place, level pixels: of a photo that is
/// turned by some degrees against its query the votes are tens of pixels off.
const ELSEWHERE_PX: f64 = 4.0 * SAME_POSITION_PX;

/// Candidates elsewhere that are matched before a clear answer ends the search, at most. Those with half of its votes are few where votes
/// tell places apart, and many where it has hardly more of them than chance gives: four did not contain the twin there.
const MAX_LOOK_ALIKES: usize = 4 * BATCH;

/// What was matched at a time.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Matched {
    /// Candidates.
    pub count: usize,
    /// Whether the best answer of the round is so clear that no further candidate is needed.
    pub is_clear: bool,
}

/// A round in progress.
pub(crate) struct OpenRound {
    result: RoundResult,
    key: QueryKey,
    cascade: Cascade,
    near: Option<Near>,
}

impl OpenRound {
    /// Finds the candidates under the hypotheses of `round`; none is matched yet. Its queries are those of an earlier round where
    /// they are the same.
    pub fn begin(
        context: Context<'_>,
        photo: &Photo,
        view: &View,
        prior: &Prior,
        (round, earlier): (Round, &[Self]),
    ) -> Result<Self> {
        let Round {
            hypotheses,
            assumption,
            purpose,
        } = round;
        let level = hypotheses.first().map_or(0, |hypothesis| hypothesis.level);
        let key = QueryKey::new(context.level(level), &hypotheses, purpose)?;
        let Queries {
            features: queries,
            dense,
            mut time_ms,
        } = match earlier.iter().find(|round| round.key.is_same(&key)) {
            Some(Self { result, .. }) => Queries {
                features: result.queries.clone(),
                dense: result.dense.clone(),
                time_ms: TimeMs::default(),
            },
            None => {
                let side_px = side_px(context, &hypotheses);
                extract_queries(context, photo, view, (&hypotheses, purpose), side_px)?
            }
        };
        let mut trace = RoundTrace {
            level,
            ..RoundTrace::default()
        };
        let is_enough = |query: &QueryFeatures| query.points.len() >= MIN_KEYPOINTS;
        let mut candidates = Vec::new();
        if queries.iter().any(is_enough) {
            let since = Instant::now();
            let (level, near) = (context.level(level), prior.near.as_ref());
            candidates = by_descriptor(level, &queries, near, context.options)?;
            trace.by_descriptor = distinct_tiles(&candidates);
            trace.by_search = trace.by_descriptor.clone();
            time_ms.search = elapsed_ms(since);
        }
        Ok(Self {
            result: RoundResult {
                level,
                hypotheses,
                queries,
                dense,
                verified: Vec::new(),
                assumption,
                trace,
                time_ms,
            },
            key,
            cascade: Cascade::new(candidates),
            near: prior.near,
        })
    }

    /// Lets the candidates of the next stage enter; false after the last stage.
    pub fn begin_stage(&mut self, context: Context<'_>) -> Result<bool> {
        if let Some(options) = &context.options.map_vote
            && options.stage == self.cascade.next_stage()
        {
            self.vote_over_map(context, options)?;
        }
        self.let_vote(context, Cascade::begin_stage)
    }

    /// Finds candidates by votes over the whole map, too, if the level has an index of its keypoints.
    fn vote_over_map(&mut self, context: Context<'_>, options: &MapVoteOptions) -> Result<()> {
        let since = Instant::now();
        let RoundResult {
            level,
            queries,
            verified,
            trace,
            time_ms,
            ..
        } = &mut self.result;
        let level = context.level(*level);
        let Some(index) = level.keypoint_index() else {
            return Ok(());
        };
        let matched: Vec<Candidate> = verified.iter().map(|v| v.candidate).collect();
        let taken = matched.iter().chain(self.cascade.unmatched());
        let (near, waiting) = (self.near.as_ref(), self.cascade.waiting());
        let mut joined = join_map_votes((level, index), queries, near, waiting, taken, options)?;
        trace.by_search = distinct_tiles(matched.iter().chain(&joined));
        joined.truncate(options.candidates);
        self.cascade.replace_waiting(joined);
        time_ms.search += elapsed_ms(since);
        Ok(())
    }

    /// Lets the candidates of at least this score enter.
    pub fn enter_scored(&mut self, context: Context<'_>, least_score: f64) -> Result<()> {
        self.let_vote(context, |cascade, vote_context| {
            cascade.enter_scored(least_score, vote_context)
        })
    }

    /// Lets the candidates that have entered vote again, with more keypoints, if there is at least this evidence for them.
    pub fn recount(
        &mut self,
        context: Context<'_>,
        keypoints: usize,
        least_evidence: f64,
    ) -> Result<()> {
        self.let_vote(context, |cascade, vote_context| {
            cascade.recount(keypoints, least_evidence, vote_context)
        })
    }

    /// The evidence for each candidate that has entered and was not matched yet, in the order in which they are matched.
    pub fn entered_evidence<'a>(&'a self, options: &'a Options) -> impl Iterator<Item = f64> + 'a {
        self.cascade.entered_evidence(options)
    }

    /// The scores of the candidates that have not entered.
    pub fn waiting_scores(&self) -> impl Iterator<Item = f64> {
        let waiting = self.cascade.waiting().iter();
        waiting.map(|candidate| f64::from(candidate.score))
    }

    fn let_vote<T>(
        &mut self,
        context: Context<'_>,
        vote: impl FnOnce(&mut Cascade, VoteContext<'_>) -> Result<T>,
    ) -> Result<T> {
        let since = Instant::now();
        let vote_context = VoteContext {
            level: context.level(self.result.level),
            queries: &self.result.queries,
            scratch: context.scratch,
            options: context.options,
        };
        let done = vote(&mut self.cascade, vote_context)?;
        self.result.time_ms.vote += elapsed_ms(since);
        Ok(done)
    }

    /// The evidence for the next candidate to be matched in full, comparable between rounds; `None` if none has entered.
    pub fn next_evidence(&self, options: &Options) -> Option<f64> {
        self.entered_evidence(options).next()
    }

    /// Matches the next candidates in full, at most `most`, in batches until the answer is clear or the time is used up. Before a clear
    /// answer ends the search, candidates of other places that have half of its votes are matched besides: they may look alike.
    pub fn match_next(
        &mut self,
        context: Context<'_>,
        most: usize,
        budget: TimeBudget,
    ) -> Result<Matched> {
        let since = Instant::now();
        let options = context.options;
        let near = self.near.as_ref();
        let RoundResult {
            level,
            hypotheses,
            queries,
            verified,
            time_ms,
            ..
        } = &mut self.result;
        let level = context.level(*level);
        let match_in_full = |batch: &[Candidate]| -> Result<Vec<VerifiedCandidate>> {
            batch
                .par_iter()
                .map(|candidate| verify(context, level, hypotheses, queries, *candidate, near))
                .collect()
        };
        let mut matched = Matched::default();
        while matched.count < most && !matched.is_clear {
            let batch = self.cascade.next_batch(BATCH.min(most - matched.count));
            if batch.is_empty() {
                break;
            }
            verified.extend(match_in_full(&batch)?);
            matched.count += batch.len();
            if verified.len() < options.min_matched {
                continue;
            }
            if let Some(best) = clear_candidate(verified, options) {
                let alike = self.cascade.next_wanted(MAX_LOOK_ALIKES, |candidate| {
                    may_look_alike(level, queries, candidate, best)
                });
                verified.extend(match_in_full(&alike)?);
                matched.count += alike.len();
                matched.is_clear = clear_candidate(verified, options).is_some();
            }
            if budget.is_spent() {
                break;
            }
        }
        time_ms.matching += elapsed_ms(since);
        Ok(matched)
    }

    /// The result, with what was searched so far.
    pub fn finish(self) -> RoundResult {
        let mut result = self.result;
        let rest: Vec<Candidate> = self.cascade.into_rest().collect();
        let matched: Vec<Candidate> = result.verified.iter().map(|v| v.candidate).collect();
        result.trace.matched = distinct_tiles(&matched);
        result.trace.by_vote = distinct_tiles(matched.iter().chain(&rest));
        result
    }
}

/// Whether a candidate has the votes of another place that looks like that of `best`.
fn may_look_alike(
    level: &Level,
    queries: &[QueryFeatures],
    candidate: &Candidate,
    best: &VerifiedCandidate,
) -> bool {
    let Some(answer) = best.centre_level_px else {
        return false;
    };
    let (centre, shift) = (queries[candidate.query].centre_px, candidate.peak.shift_px);
    let voted_for = TileFrame::new(level, candidate.tile).level_px_from_tile_px(TilePx {
        x: centre.x + shift.x,
        y: centre.y + shift.y,
    });
    has_votes_elsewhere(
        (voted_for, candidate.peak.votes),
        (answer, best.candidate.peak.votes),
    )
}

/// Whether the first position has at least half of the votes of the second and is another.
fn has_votes_elsewhere((at, votes): (LevelPx, u32), (answer, of_answer): (LevelPx, u32)) -> bool {
    votes > 0 && 2 * votes >= of_answer && (at.x - answer.x).hypot(at.y - answer.y) >= ELSEWHERE_PX
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_places_with_half_of_the_votes_may_look_alike() {
        let answer = (LevelPx::new(500.0, 400.0), 60);
        let elsewhere = LevelPx::new(500.0 + ELSEWHERE_PX, 400.0);
        let beside = LevelPx::new(500.0, 401.0 - ELSEWHERE_PX);
        assert!(has_votes_elsewhere((elsewhere, 60), answer));
        assert!(has_votes_elsewhere((elsewhere, 30), answer));
        assert!(!has_votes_elsewhere((elsewhere, 29), answer));
        assert!(!has_votes_elsewhere((beside, 60), answer));
        // Without a vote nothing is known of them.
        let without = (LevelPx::new(500.0, 400.0), 0);
        assert!(!has_votes_elsewhere((elsewhere, 0), without));
    }
}
