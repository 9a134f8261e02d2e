//! What every table of a run has in common.

use grimnet_experiments::experiment_table::ExperimentTable;
use grimnet_net::Model;

/// Digits of a model's hash in a table.
const HASH_DIGITS: usize = 12;

/// What a table was measured on.
pub struct Conditions {
    /// The data, in words.
    pub data: String,
    /// Photos.
    pub frames: usize,
}

impl Conditions {
    /// The table with its conditions; a table that compares trained networks has no one model.
    pub fn added_to(&self, mut table: ExperimentTable, model: Option<&Model>) -> ExperimentTable {
        let hash = model.map(|m| m.hash().to_string().chars().take(HASH_DIGITS).collect());
        let all = [
            ("data", Some(self.data.clone())),
            ("frames", Some(self.frames.to_string())),
            ("model", hash),
            (
                "program",
                Some(format!("grim {}", env!("CARGO_PKG_VERSION"))),
            ),
            ("threads", Some(rayon::current_num_threads().to_string())),
        ];
        for (name, value) in all {
            if let Some(value) = value {
                table.conditions.insert(name.to_owned(), value);
            }
        }
        table
    }
}
