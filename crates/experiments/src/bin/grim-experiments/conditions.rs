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
        // As in the summaries of `grim eval`: not where it is single precision.
        let precision = model.map(Model::precision).filter(|one| !one.is_f32());
        let all = [
            ("data", Some(self.data.clone())),
            ("frames", Some(self.frames.to_string())),
            ("model", hash),
            ("precision", precision.map(|one| one.to_string())),
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

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_net::Precision;

    #[test]
    fn precision_is_stated_if_it_is_not_single_precision() {
        let conditions = Conditions {
            data: "5 procedural worlds".to_owned(),
            frames: 5,
        };
        for (precision, expected) in [(Precision::F32, None), (Precision::Int8, Some("int8"))] {
            let model = Model::bundled().unwrap().with_precision(precision).unwrap();
            let table = conditions.added_to(ExperimentTable::default(), Some(&model));
            let stated = table.conditions.get("precision").map(String::as_str);
            assert_eq!(stated, expected);
            assert!(table.conditions.contains_key("model"));
        }
    }
}
