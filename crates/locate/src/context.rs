//! What every stage of the pipeline needs.

use std::time::Instant;

use grimnet_net::{Extractor, Model};
use grimnet_pack::{Level, Pack};

use crate::{options::Options, outcome::elapsed_ms, search::scratch::ScratchPool};

/// The model, the pack, the settings and the buffers of a localiser.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub model: &'a Model,
    pub pack: &'a Pack,
    pub extractor: &'a Extractor,
    pub options: &'a Options,
    pub scratch: &'a ScratchPool,
}

impl<'a> Context<'a> {
    /// A level of the pack.
    pub fn level(&self, index: usize) -> &'a Level {
        &self.pack.levels()[index]
    }

    /// The time limit of a search that starts now.
    pub fn start_budget(&self) -> TimeBudget {
        TimeBudget {
            start: Instant::now(),
            limit_ms: self.options.budget_ms,
        }
    }
}

/// The time limit of one search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TimeBudget {
    start: Instant,
    limit_ms: Option<f64>,
}

impl TimeBudget {
    /// Time since the search started, milliseconds.
    pub fn elapsed_ms(&self) -> f64 {
        elapsed_ms(self.start)
    }

    /// Whether the time is used up. Never without a limit.
    pub fn is_spent(&self) -> bool {
        self.limit_ms
            .is_some_and(|limit_ms| self.elapsed_ms() >= limit_ms)
    }
}
