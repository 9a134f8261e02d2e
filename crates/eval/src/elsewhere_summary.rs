//! Figures of wrong-area trials.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::elsewhere::{ElsewhereTrial, Scale};
use crate::metrics::statistics::{grouped_share_interval, mean};

/// Limits between small, medium and large footprints, as shares of the map's width.
const BANDS: [f64; 2] = [1.0 / 3.0, 1.0];

/// Trials and fixes of one group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Group {
    /// What the trials have in common.
    pub name: String,
    /// Number of trials.
    pub trials: usize,
    /// Trials with a fix.
    pub fixes: usize,
    /// Share of trials with a fix.
    pub share: f64,
    /// 95 % interval of the share, by picture, for the crops of one are not independent: whole pictures are resampled (bootstrap), or,
    /// if all have the same share, it is Wilson's on their number.
    pub share_interval: [f64; 2],
    /// Number of pictures that the trials are of.
    pub pictures: usize,
}

/// Figures of all trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ElsewhereSummary {
    /// All trials.
    pub all: Group,
    /// Sources that the model was trained on, and the others.
    pub by_training: Vec<Group>,
    /// Settings: scale, heading and size of the footprint.
    pub by_setting: Vec<Group>,
    /// Sources.
    pub by_source: Vec<Group>,
    /// Number of trials without a fix by reason, most frequent first.
    pub reasons: Vec<(String, usize)>,
}

/// Scale, heading and size of the footprint of a trial.
fn setting(trial: &ElsewhereTrial) -> String {
    let scale = match trial.scale {
        Scale::Metadata => "scale from metadata",
        Scale::Drawn => "scale drawn",
        Scale::NotGiven => "scale not given",
    };
    let heading = if trial.heading_known {
        "known"
    } else {
        "unknown"
    };
    let Some(share) = trial.map_share else {
        return format!("{scale}, heading {heading}");
    };
    let size = match BANDS.iter().filter(|&&limit| share > limit).count() {
        0 => "up to a third of the map",
        1 => "a third of the map to its size",
        _ => "larger than the map",
    };
    format!("{scale}, heading {heading}, footprint {size}")
}

impl Group {
    fn of<'a>(name: &str, trials: impl Iterator<Item = &'a ElsewhereTrial>) -> Self {
        let mut by_picture: BTreeMap<(&str, &str), Vec<f64>> = BTreeMap::new();
        for trial in trials {
            by_picture
                .entry((&trial.source, &trial.picture))
                .or_default()
                .push(f64::from(u8::from(trial.fixed)));
        }
        let by_picture: Vec<Vec<f64>> = by_picture.into_values().collect();
        let all = by_picture.concat();
        Self {
            name: name.to_owned(),
            trials: all.len(),
            fixes: all.iter().filter(|fixed| **fixed > 0.0).count(),
            share: mean(&all).unwrap_or(0.0),
            share_interval: grouped_share_interval(&by_picture),
            pictures: by_picture.len(),
        }
    }
}

/// A group for each name, in the order of the names.
fn groups(trials: &[ElsewhereTrial], name: impl Fn(&ElsewhereTrial) -> String) -> Vec<Group> {
    let mut named: BTreeMap<String, Vec<&ElsewhereTrial>> = BTreeMap::new();
    for trial in trials {
        named.entry(name(trial)).or_default().push(trial);
    }
    named
        .into_iter()
        .map(|(name, trials)| Group::of(&name, trials.into_iter()))
        .collect()
}

impl ElsewhereSummary {
    /// Figures of these trials.
    #[must_use]
    pub fn of(trials: &[ElsewhereTrial]) -> Self {
        let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
        for reason in trials.iter().filter_map(|trial| trial.reason.as_deref()) {
            // What follows a colon are figures of the single trial.
            let kind = reason.split([':', ';']).next().unwrap_or(reason);
            *reasons.entry(kind).or_default() += 1;
        }
        let mut reasons: Vec<(String, usize)> = reasons
            .into_iter()
            .map(|(reason, count)| (reason.to_owned(), count))
            .collect();
        reasons.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        Self {
            all: Group::of("all trials", trials.iter()),
            by_training: groups(trials, |trial| {
                let training = if trial.trained_on {
                    "sources trained on"
                } else {
                    "sources not trained on"
                };
                training.to_owned()
            }),
            by_setting: groups(trials, setting),
            by_source: groups(trials, |trial| trial.source.clone()),
            reasons,
        }
    }
}
