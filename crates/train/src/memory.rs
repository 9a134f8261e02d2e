//! Global descriptors of past batches: more negatives than a batch holds (Wang et al. 2020, cross-batch memory).

use crate::data::{Batch, Place};
use burn::tensor::Tensor;
use std::collections::VecDeque;

/// Views that share more than this of their area are no negatives of each other.
const OVERLAP: f64 = 0.05;

/// The map views of the last batches, oldest first.
pub(crate) struct Memory {
    batches: usize,
    past: VecDeque<(Tensor<2>, Vec<Place>)>,
}

impl Memory {
    /// Room for that many batches.
    pub fn new(batches: usize) -> Self {
        Self {
            batches,
            past: VecDeque::new(),
        }
    }

    /// Adds the map views of a batch, `[pairs, d]`, and forgets the oldest.
    pub fn push(&mut self, sat: Tensor<2>, batch: &Batch) {
        let places = batch.iter().map(|pair| pair.place).collect();
        self.past.push_back((sat.without_autodiff(), places));
        while self.past.len() > self.batches {
            self.past.pop_front();
        }
    }

    /// All rows, `[m, d]`, as constants of a graph; `None` where there are none.
    pub fn rows(&self) -> Option<Tensor<2>> {
        if self.past.is_empty() {
            return None;
        }
        let rows = self.past.iter().map(|(rows, _)| rows.clone()).collect();
        Some(Tensor::cat(rows, 0).autodiff())
    }

    /// For each pair of the batch and each map view of the batch, then of the memory: whether they show one place, so that
    /// the view is no negative. Row by row.
    pub fn excluded(&self, batch: &Batch) -> Vec<bool> {
        let past: Vec<&Place> = self.past.iter().flat_map(|(_, places)| places).collect();
        let mut out = Vec::with_capacity(batch.len() * (batch.len() + past.len()));
        for row in batch {
            let overlaps = |other: &Place| row.place.overlap(other) > OVERLAP;
            out.extend(batch.iter().map(|column| overlaps(&column.place)));
            out.extend(past.iter().map(|place| overlaps(place)));
        }
        out
    }
}

/// For each pair of the batch and each map view of the batch: whether they show one place. Row by row.
pub(crate) fn overlaps_within(batch: &Batch) -> Vec<bool> {
    Memory::new(0).excluded(batch)
}
