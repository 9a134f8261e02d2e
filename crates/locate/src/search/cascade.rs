//! The cascade of one round. Candidates enter in stages, best by score first; those that have entered are ranked by the
//! translation vote and are matched in full in that order. A clear answer in an early stage makes the later stages unnecessary.

use grimnet_pack::Level;

use crate::{
    error::Result,
    options::{Options, VoteOptions},
    query_features::QueryFeatures,
    search::{
        candidates::{Candidate, rank_by_votes, vote},
        scratch::ScratchPool,
    },
};

/// What a vote needs beside the candidates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VoteContext<'a> {
    /// The level that the candidates are tiles of.
    pub level: &'a Level,
    /// The queries that the candidates belong to.
    pub queries: &'a [QueryFeatures],
    /// Buffers.
    pub scratch: &'a ScratchPool,
    /// Settings.
    pub options: &'a Options,
}

/// The candidates of one round that were not matched yet.
#[derive(Debug, Default)]
pub(crate) struct Cascade {
    /// Candidates that have not entered, best by score first.
    waiting: std::vec::IntoIter<Candidate>,
    /// Candidates that have entered and were not matched yet, best by votes first.
    entered: Vec<Candidate>,
    /// Candidates that have entered and did not take part in the second vote, best of each stage first.
    passed_over: Vec<Candidate>,
    stages_begun: usize,
    /// Whether candidates that are in no listed stage are left out.
    is_limited: bool,
}

impl Cascade {
    /// Starts with `candidates`, best by score first.
    pub fn new(candidates: Vec<Candidate>) -> Self {
        Self {
            waiting: candidates.into_iter(),
            ..Self::default()
        }
    }

    /// Number of the next stage, from 0.
    pub fn next_stage(&self) -> usize {
        self.stages_begun
    }

    /// Replaces the candidates that have not entered by others, best by score first. Those that are in no listed stage then never enter.
    pub fn replace_waiting(&mut self, candidates: Vec<Candidate>) {
        self.waiting = candidates.into_iter();
        self.is_limited = true;
    }

    /// The candidates that have entered and were not matched yet.
    pub fn unmatched(&self) -> impl Iterator<Item = &Candidate> {
        self.entered.iter().chain(&self.passed_over)
    }

    /// Lets the candidates of the next stage enter and vote; false after the last stage.
    ///
    /// # Errors
    /// Returns an error if the descriptors of query and pack do not have the same length.
    pub fn begin_stage(&mut self, context: VoteContext<'_>) -> Result<bool> {
        let Some(size) = self.stage_size(context.options) else {
            return Ok(false);
        };
        self.enter(size, context)?;
        self.stages_begun += 1;
        Ok(true)
    }

    /// Lets the candidates of at least this score enter and vote.
    ///
    /// # Errors
    /// As [`Self::begin_stage`].
    pub fn enter_scored(&mut self, least_score: f32, context: VoteContext<'_>) -> Result<()> {
        let waiting = self.waiting.as_slice();
        let size = waiting.partition_point(|candidate| candidate.score >= least_score);
        self.enter(size, context)
    }

    /// The candidates that have not entered, best by score first.
    pub fn waiting(&self) -> &[Candidate] {
        self.waiting.as_slice()
    }

    /// The next candidate to match in full; `None` if all that have entered were matched.
    pub fn next(&self) -> Option<&Candidate> {
        self.entered.first()
    }

    /// The next candidates to match in full, at most `most`.
    pub fn next_batch(&mut self, most: usize) -> Vec<Candidate> {
        let count = most.min(self.entered.len());
        self.entered.drain(..count).collect()
    }

    /// The candidates that were not matched, in the order in which they would have been.
    pub fn into_rest(self) -> impl Iterator<Item = Candidate> {
        self.entered
            .into_iter()
            .chain(self.passed_over)
            .chain(self.waiting)
    }

    /// Lets the next `size` candidates enter and vote.
    fn enter(&mut self, size: usize, context: VoteContext<'_>) -> Result<()> {
        let mut entering: Vec<Candidate> = self.waiting.by_ref().take(size).collect();
        if let Some(options) = &context.options.vote {
            self.count_votes(&mut entering, context, options)?;
            self.entered.extend(entering);
            rank_by_votes(&mut self.entered, options);
        } else {
            self.entered.extend(entering);
        }
        Ok(())
    }

    /// Lets the candidates vote, and the best of them again with more keypoints. The others are passed over.
    fn count_votes(
        &mut self,
        entering: &mut Vec<Candidate>,
        context: VoteContext<'_>,
        options: &VoteOptions,
    ) -> Result<()> {
        let vote = |candidates: &mut [Candidate], keypoints: usize| {
            vote(
                context.level,
                context.queries,
                candidates,
                keypoints,
                context.scratch,
                options,
            )
        };
        vote(entering, options.keypoints)?;
        let recount = options
            .recount
            .filter(|_| entering.len() > context.options.max_matched);
        if let Some(recount) = recount {
            rank_by_votes(entering, options);
            let others = entering.split_off(recount.candidates.min(entering.len()));
            vote(entering, recount.keypoints)?;
            self.passed_over.extend(others);
        }
        Ok(())
    }

    /// Number of candidates that enter in the next stage; `None` if all have entered.
    fn stage_size(&self, options: &Options) -> Option<usize> {
        if self.waiting.as_slice().is_empty() {
            return None;
        }
        let listed = options.stages.get(self.stages_begun).copied();
        listed.or_else(|| (!self.is_limited).then_some(usize::MAX))
    }
}
