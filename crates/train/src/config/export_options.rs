//! Settings of the export.

use grimnet_net::DataType;
use serde::{Deserialize, Serialize};

/// Which whitening an exported model gets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WhiteningChoice {
    /// The one with the highest recall on the held-out pairs, which may be none.
    #[default]
    Measured,
    /// PCA whitening (paper, eq. 8), whatever it measures.
    Pca,
}

/// How many pairs the exported model is fitted to and measured on, where each view costs a forward pass, and its licence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExportOptions {
    /// Which whitening is kept: `measured` (the best on held-out pairs, or none) or `pca` (always, as in the paper).
    pub whitening: WhiteningChoice,
    /// Pairs that the whitening is fitted to; more than the global descriptor has values, or 0 for no whitening.
    pub whitening_pairs: usize,
    /// Held-out pairs that the model is measured on.
    pub validation_pairs: usize,
    /// Training views added to the gallery of the recall measurement.
    pub distractors: usize,
    /// Precision of the stored whitening projection: `i8` or `f16`.
    pub whitening_precision: DataType,
    /// Licence of the weights, for the model's card: they are made from the caller's pictures.
    pub licence: String,
}

impl Default for ExportOptions {
    fn default() -> Self {
        Self {
            whitening: WhiteningChoice::Measured,
            whitening_pairs: 5000,
            validation_pairs: 240,
            distractors: 300,
            whitening_precision: DataType::I8,
            licence: "not stated".to_owned(),
        }
    }
}
