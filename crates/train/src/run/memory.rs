//! Global descriptors of past batches as additional negatives (cross-batch memory; Wang et al. 2020).

use crate::data::{Batch, Place};
use burn::tensor::Tensor;
use std::collections::VecDeque;

/// Views whose areas overlap by more than this share are not negatives of each other.
const OVERLAP: f64 = 0.05;

/// Descriptors of the map views of the last batches, oldest first.
pub(crate) struct Memory {
    batches: usize,
    past: VecDeque<(Tensor<2>, Vec<Place>)>,
}

impl Memory {
    /// A memory of this many batches.
    pub fn new(batches: usize) -> Self {
        Self {
            batches,
            past: VecDeque::new(),
        }
    }

    /// Adds the descriptors of the map views of a batch, `[pairs, d]`, and drops the oldest batch.
    pub fn push(&mut self, sat: Tensor<2>, batch: &Batch) {
        let places = batch.iter().map(|pair| pair.place).collect();
        self.past.push_back((sat.without_autodiff(), places));
        while self.past.len() > self.batches {
            self.past.pop_front();
        }
    }

    /// All descriptors, `[m, d]`, as constants of an autodiff graph; `None` if there are none.
    pub fn rows(&self) -> Option<Tensor<2>> {
        if self.past.is_empty() {
            return None;
        }
        let rows = self.past.iter().map(|(rows, _)| rows.clone()).collect();
        Some(Tensor::cat(rows, 0).autodiff())
    }

    /// For each pair of the batch (rows) and each map view of the batch and then of the memory (columns): whether the view
    /// overlaps the place of the pair and therefore is not a negative.
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

/// For each pair of the batch (rows) and each map view of the batch (columns): whether they overlap.
pub(crate) fn overlaps_within(batch: &Batch) -> Vec<bool> {
    Memory::new(0).excluded(batch)
}
