//! Settings of the export.

use grimnet_net::Precision;
use serde::{Deserialize, Serialize};

/// How many pairs the exported model is fitted to and measured on. Each view costs a forward pass.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExportOptions {
    /// Pairs that the whitening is fitted to; more than the global descriptor has values, or 0 for no whitening.
    pub whitening_pairs: usize,
    /// Held-out pairs that the model is measured on.
    pub validation_pairs: usize,
    /// Training views added to the gallery of the recall measurement.
    pub distractors: usize,
    /// Precision of the stored whitening projection: `i8` or `f16`.
    pub whitening_precision: Precision,
}

impl Default for ExportOptions {
    fn default() -> Self {
        Self {
            whitening_pairs: 5000,
            validation_pairs: 240,
            distractors: 300,
            whitening_precision: Precision::I8,
        }
    }
}
