//! What differs between the configuration that a checkpoint was trained with and the one that goes on from it.

use super::TrainConfig;
use crate::error::TrainError;
use std::collections::BTreeSet;
use toml::{Table, Value};

/// Settings, or tables of them, that do not change the parameters that a run arrives at.
const WITHOUT_EFFECT: [&str; 8] = [
    "out",
    "device",
    "data_threads",
    "checkpoint_minutes",
    "validate_minutes",
    "report_steps",
    "export",
    "labels.folder",
];
/// The schedule of the steps to come, which may change: to train longer, or with a lower rate after a loss that was not finite.
const SCHEDULE: [&str; 7] = [
    "minutes",
    "steps",
    "learning_rate",
    "encoder_rate",
    "warmup_steps",
    "decay_from",
    "clip",
];

/// Changed settings, each as its key with both values.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Changes {
    /// Those that a run may change.
    pub schedule: Vec<String>,
    /// Those with which it would be another run.
    pub others: Vec<String>,
}

impl Changes {
    /// What changes from `earlier` to `now`, without settings that have no effect on the parameters.
    ///
    /// # Errors
    /// [`TrainError::Config`] if one of them cannot be written as TOML.
    pub fn between(earlier: &TrainConfig, now: &TrainConfig) -> Result<Self, TrainError> {
        let mut out = Self::default();
        let [earlier, now] = [earlier.to_table()?, now.to_table()?].map(Value::Table);
        out.compare("", Some(&earlier), Some(&now));
        Ok(out)
    }

    /// Compares the values of a key, which may be a table, and is empty for the whole configuration.
    fn compare(&mut self, key: &str, earlier: Option<&Value>, now: Option<&Value>) {
        if earlier == now || WITHOUT_EFFECT.contains(&key) {
            return;
        }
        match (earlier, now) {
            (Some(Value::Table(a)), Some(Value::Table(b))) => {
                let names: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
                for name in names {
                    let dot = if key.is_empty() { "" } else { "." };
                    self.compare(&format!("{key}{dot}{name}"), a.get(name), b.get(name));
                }
            }
            (Some(Value::Array(a)), Some(Value::Array(b))) if a.len() == b.len() => {
                for (i, (a, b)) in a.iter().zip(b).enumerate() {
                    self.compare(&format!("{key}[{i}]"), Some(a), Some(b));
                }
            }
            _ => {
                let kind = if SCHEDULE.contains(&key) {
                    &mut self.schedule
                } else {
                    &mut self.others
                };
                kind.push(format!("`{key}` was {}, now {}", text(earlier), text(now)));
            }
        }
    }
}

/// A value for a message.
fn text(value: Option<&Value>) -> String {
    match value {
        None => "not set".to_owned(),
        Some(Value::Table(_)) => "set".to_owned(),
        Some(Value::Array(entries)) => format!("{} entries", entries.len()),
        // Single precision has the digits of the file for both kinds of floats.
        Some(Value::Float(value)) => format!("{}", *value as f32),
        Some(value) => value.to_string(),
    }
}

impl TrainConfig {
    /// The configuration as TOML.
    ///
    /// # Errors
    /// [`TrainError::Config`] if a value cannot be written: a path that is not UTF-8, or a seed above 2^63 - 1.
    pub(crate) fn to_table(&self) -> Result<Table, TrainError> {
        Table::try_from(self).map_err(|error| TrainError::Config {
            reason: format!("a value cannot be written as TOML, as checkpoints need it: {error}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::GlobalLoss;
    use crate::data::{Folder, Layout, Serves};
    use crate::model::input::Norms;

    fn folder(path: &str) -> Folder {
        Folder {
            path: path.into(),
            layout: Layout::Pictures,
            repeat: 1,
            serves: Serves::Both,
        }
    }

    #[test]
    fn a_run_may_change_its_schedule_and_what_has_no_effect() {
        let earlier = TrainConfig {
            data: vec![folder("pictures")],
            ..TrainConfig::paper()
        };
        let unchanged = Changes::between(&earlier, &earlier.clone()).unwrap();
        assert_eq!(unchanged, Changes::default());
        let mut now = TrainConfig {
            out: "elsewhere".into(),
            data_threads: 7,
            learning_rate: 5e-4,
            steps: Some(9),
            ..earlier.clone()
        };
        now.export.validation_pairs = 1;
        let changes = Changes::between(&earlier, &now).unwrap();
        assert!(changes.others.is_empty(), "{changes:?}");
        assert_eq!(
            changes.schedule,
            [
                "`learning_rate` was 0.001, now 0.0005",
                "`steps` was not set, now 9"
            ]
        );
    }

    #[test]
    fn what_makes_it_another_run_is_named_with_both_values() {
        let earlier = TrainConfig {
            data: vec![folder("pictures")],
            ..TrainConfig::default()
        };
        let mut now = TrainConfig {
            seed: 99,
            norms: Norms::Joint,
            global_loss: GlobalLoss::Triplet,
            average_decay: 0.9,
            data: vec![folder("others")],
            ..earlier.clone()
        };
        now.pairs.look.snow = 0.1;
        let changes = Changes::between(&earlier, &now).unwrap();
        assert!(changes.schedule.is_empty(), "{changes:?}");
        assert_eq!(
            changes.others,
            [
                "`average_decay` was 0.998, now 0.9",
                "`data[0].path` was \"pictures\", now \"others\"",
                "`global_loss` was \"contrast\", now \"triplet\"",
                "`norms` was \"by_domain\", now \"joint\"",
                "`pairs.look.snow` was 0, now 0.1",
                "`seed` was 1, now 99",
            ]
        );
    }
}
