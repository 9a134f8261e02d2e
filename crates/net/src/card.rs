//! The model card.

use serde::{Deserialize, Serialize};

/// Model card: origin and permitted use of a model, written into the model file.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Card {
    /// Display name.
    pub name: String,
    /// Training data.
    pub training_data: String,
    /// Number of optimisation steps.
    pub steps: u64,
    /// Licence of the weights.
    pub licence: String,
    /// Further remarks: figures, limits.
    pub notes: String,
    /// Whether the weights are random, so that the model cannot localise.
    pub random: bool,
}
