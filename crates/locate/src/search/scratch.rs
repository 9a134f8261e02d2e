//! Buffers that matching reuses from one candidate to the next.

use std::sync::{Mutex, PoisonError};

use grimnet_kernels::Isa;
use nalgebra::Point2;

use crate::search::{
    matching::{Match, Matcher},
    vote::Histogram,
};

/// Buffers of one matching thread.
pub(crate) struct Scratch {
    pub matcher: Matcher,
    pub matches: Vec<Match>,
    pub guided: Vec<Match>,
    pub histogram: Histogram,
    pub points: Vec<Point2<f32>>,
}

/// Buffers that are not in use.
#[derive(Default)]
pub(crate) struct ScratchPool(Mutex<Vec<Scratch>>);

impl ScratchPool {
    /// Calls `work` with buffers from the pool; new ones are made if all are in use.
    pub fn with<R>(&self, work: impl FnOnce(&mut Scratch) -> R) -> R {
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut scratch = free.unwrap_or_else(|| Scratch {
            matcher: Matcher::new(Isa::detect()),
            matches: Vec::new(),
            guided: Vec::new(),
            histogram: Histogram::default(),
            points: Vec::new(),
        });
        let result = work(&mut scratch);
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(scratch);
        result
    }
}

impl std::fmt::Debug for ScratchPool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ScratchPool")
    }
}
