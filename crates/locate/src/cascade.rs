//! The cascade of one round: candidates enter by descriptor, a stage at a time; those that have entered are ranked by the
//! translation vote and leave, best first, to be matched in full. A clear answer in an early stage spares the later ones.

use std::time::Instant;

use grimnet_pack::Level;

use crate::{
    candidates::{Candidate, Desks, hold_vote, rank_by_votes},
    error::Result,
    options::Options,
    outcome::elapsed_ms,
    query_features::QueryFeatures,
};

/// The candidates of one round that have not been matched yet.
pub(crate) struct Cascade<'a> {
    level: &'a Level,
    queries: &'a [QueryFeatures],
    desks: &'a Desks,
    options: &'a Options,
    /// Best by descriptor first.
    outside: std::vec::IntoIter<Candidate>,
    /// Best by votes first.
    entered: Vec<Candidate>,
    stages_begun: usize,
    left_in_stage: usize,
    /// Time spent on votes, milliseconds.
    pub vote_ms: f64,
}

impl<'a> Cascade<'a> {
    /// Of `candidates`, best by descriptor first.
    pub fn new(
        level: &'a Level,
        queries: &'a [QueryFeatures],
        candidates: Vec<Candidate>,
        desks: &'a Desks,
        options: &'a Options,
    ) -> Self {
        Self {
            level,
            queries,
            desks,
            options,
            outside: candidates.into_iter(),
            entered: Vec::new(),
            stages_begun: 0,
            left_in_stage: 0,
            vote_ms: 0.0,
        }
    }

    /// The next candidates to be matched in full, at most `most`; none once all stages are over.
    ///
    /// # Errors
    /// Where descriptors of query and pack do not fit.
    pub fn next_batch(&mut self, most: usize) -> Result<Vec<Candidate>> {
        if self.left_in_stage == 0 || self.entered.is_empty() {
            self.begin_stage()?;
        }
        let count = most.min(self.left_in_stage).min(self.entered.len());
        self.left_in_stage -= count;
        Ok(self.entered.drain(..count).collect())
    }

    /// What is left, in the order in which it would be matched.
    pub fn into_rest(self) -> impl Iterator<Item = Candidate> {
        self.entered.into_iter().chain(self.outside)
    }

    fn begin_stage(&mut self) -> Result<()> {
        let since = Instant::now();
        let Some(size) = self.stage_size() else {
            self.entered.clear();
            return Ok(());
        };
        let mut fresh: Vec<Candidate> = self.outside.by_ref().take(size).collect();
        hold_vote(
            self.level,
            self.queries,
            &mut fresh,
            self.desks,
            self.options,
        )?;
        self.entered.extend(fresh);
        rank_by_votes(&mut self.entered);
        self.stages_begun += 1;
        self.left_in_stage = self.options.max_matched;
        self.vote_ms += elapsed_ms(since);
        Ok(())
    }

    /// How many enter in the stage that begins now: as the options say, then all that are left; none when all have entered.
    fn stage_size(&self) -> Option<usize> {
        let listed = self.options.stages.get(self.stages_begun).copied();
        let all_entered = self.outside.as_slice().is_empty();
        (!all_entered).then(|| listed.unwrap_or(usize::MAX))
    }
}
