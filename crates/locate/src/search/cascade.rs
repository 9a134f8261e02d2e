//! The cascade of one round. Candidates enter in stages, best by score first; those that have entered are ranked by the
//! translation vote and are matched in full in that order. A clear answer in an early stage makes the later stages unnecessary.

use grimnet_pack::Level;

use crate::{
    error::Result,
    options::{Options, Recount},
    query_features::QueryFeatures,
    search::{
        candidates::{Candidate, evidence, rank_by_votes, vote},
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

impl VoteContext<'_> {
    /// Lets the strongest `keypoints` of each candidate vote, if there is a vote.
    fn vote(self, candidates: &mut [Candidate], keypoints: usize) -> Result<()> {
        let Some(options) = &self.options.vote else {
            return Ok(());
        };
        let (level, queries) = (self.level, self.queries);
        vote(level, queries, candidates, keypoints, self.scratch, options)
    }
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

    /// Replaces the candidates that have not entered by others, best by score first.
    pub fn replace_waiting(&mut self, candidates: Vec<Candidate>) {
        self.waiting = candidates.into_iter();
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
        let recount = context.options.vote.and_then(|vote| vote.recount);
        self.enter(size, recount, context)?;
        self.stages_begun += 1;
        Ok(true)
    }

    /// Lets the candidates of at least this score enter and vote, none of them twice.
    ///
    /// # Errors
    /// As [`Self::begin_stage`].
    pub fn enter_scored(&mut self, least_score: f64, context: VoteContext<'_>) -> Result<()> {
        let waiting = self.waiting.as_slice();
        let size = waiting.partition_point(|candidate| f64::from(candidate.score) >= least_score);
        self.enter(size, None, context)
    }

    /// Lets the candidates that have entered vote again, with more keypoints, if there is at least this evidence for them. The others
    /// are passed over.
    ///
    /// # Errors
    /// As [`Self::begin_stage`].
    pub fn recount(
        &mut self,
        keypoints: usize,
        least_evidence: f64,
        context: VoteContext<'_>,
    ) -> Result<()> {
        let count = self
            .entered_evidence(context.options)
            .take_while(|&evidence| evidence >= least_evidence)
            .count();
        self.passed_over.extend(self.entered.drain(count..));
        context.vote(&mut self.entered, keypoints)?;
        self.rank(context.options);
        Ok(())
    }

    /// The evidence for each candidate that has entered and was not matched yet, in the order in which they are matched.
    pub fn entered_evidence<'a>(&'a self, options: &'a Options) -> impl Iterator<Item = f64> + 'a {
        let entered = self.entered.iter();
        entered.map(|candidate| evidence(candidate, options.vote.as_ref()))
    }

    /// The candidates that have not entered, best by score first.
    pub fn waiting(&self) -> &[Candidate] {
        self.waiting.as_slice()
    }

    /// The next candidates to match in full, at most `most`.
    pub fn next_batch(&mut self, most: usize) -> Vec<Candidate> {
        let count = most.min(self.entered.len());
        self.entered.drain(..count).collect()
    }

    /// The next candidates to match in full among those that are `wanted`, at most `most`.
    pub fn next_wanted(
        &mut self,
        most: usize,
        wanted: impl Fn(&Candidate) -> bool,
    ) -> Vec<Candidate> {
        let mut taken = Vec::new();
        self.entered.retain(|candidate| {
            let is_taken = taken.len() < most && wanted(candidate);
            if is_taken {
                taken.push(*candidate);
            }
            !is_taken
        });
        taken
    }

    /// The candidates that were not matched, in the order in which they would have been.
    pub fn into_rest(self) -> impl Iterator<Item = Candidate> {
        self.entered
            .into_iter()
            .chain(self.passed_over)
            .chain(self.waiting)
    }

    /// Lets the next `size` candidates enter and vote, and the best of all that have entered again with more keypoints, if those that
    /// enter are more than can be matched. The others are passed over.
    fn enter(
        &mut self,
        size: usize,
        recount: Option<Recount>,
        context: VoteContext<'_>,
    ) -> Result<()> {
        let options = context.options;
        let mut entering: Vec<Candidate> = self.waiting.by_ref().take(size).collect();
        if let Some(votes) = &options.vote {
            context.vote(&mut entering, votes.keypoints)?;
            if let Some(recount) = recount.filter(|_| entering.len() > options.max_matched) {
                // Votes of as many keypoints are comparable, so those that have entered before are among them.
                entering.append(&mut self.entered);
                rank_by_votes(&mut entering, votes);
                let others = entering.split_off(recount.candidates.min(entering.len()));
                context.vote(&mut entering, recount.keypoints)?;
                self.passed_over.extend(others);
            }
        }
        self.entered.extend(entering);
        self.rank(options);
        Ok(())
    }

    fn rank(&mut self, options: &Options) {
        if let Some(votes) = &options.vote {
            rank_by_votes(&mut self.entered, votes);
        }
    }

    /// Number of candidates that enter in the next stage; `None` if all have entered.
    fn stage_size(&self, options: &Options) -> Option<usize> {
        if self.waiting.as_slice().is_empty() {
            return None;
        }
        let listed = options.stages.get(self.stages_begun).copied();
        Some(listed.unwrap_or(usize::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::vote::Peak;

    #[test]
    fn wanted_candidates_are_taken_before_their_turn() {
        let candidate = |tile| Candidate {
            query: 0,
            tile,
            similarity: 0.0,
            score: 0.0,
            peak: Peak::default(),
        };
        let mut cascade = Cascade {
            entered: (0..6).map(candidate).collect(),
            ..Cascade::default()
        };
        let tiles = |of: Vec<Candidate>| of.iter().map(|c| c.tile).collect::<Vec<_>>();
        let odd = cascade.next_wanted(2, |candidate| candidate.tile % 2 == 1);
        assert_eq!(tiles(odd), [1, 3]);
        assert!(cascade.next_wanted(2, |_| false).is_empty());
        assert_eq!(tiles(cascade.next_batch(9)), [0, 2, 4, 5]);
    }
}
