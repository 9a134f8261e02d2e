//! Figures of wrong-area trials.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::elsewhere::{ElsewhereTrial, Scale};
use crate::metrics::statistics::wilson_interval;

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
    /// 95 % interval of the share (Wilson 1927), as of so many trials as there are pictures: the crops of one are not independent.
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
    /// Number of trials without a fix by reason, most frequent first. Figures of the single trial are `...`.
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

/// A reason with `...` in place of its figures, as `docs/answers.md` lists it.
fn without_figures(reason: &str) -> String {
    let mut words = String::new();
    let mut is_figure = false;
    for c in reason.chars() {
        let is_part = c.is_ascii_digit() || is_figure && matches!(c, '.' | 'e' | '-');
        if !is_part {
            words.push(c);
        } else if !is_figure {
            words.push_str("...");
        }
        is_figure = is_part;
    }
    words
}

impl Group {
    fn of<'a>(name: &str, trials: impl Iterator<Item = &'a ElsewhereTrial>) -> Self {
        let mut pictures = BTreeSet::new();
        let (mut count, mut fixes) = (0usize, 0usize);
        for trial in trials {
            pictures.insert((&trial.source, &trial.picture));
            count += 1;
            fixes += usize::from(trial.fixed);
        }
        let share = fixes as f64 / count.max(1) as f64;
        Self {
            name: name.to_owned(),
            trials: count,
            fixes,
            share,
            share_interval: wilson_interval(share, pictures.len()),
            pictures: pictures.len(),
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
        let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
        for reason in trials.iter().filter_map(|trial| trial.reason.as_deref()) {
            *reasons.entry(without_figures(reason)).or_default() += 1;
        }
        let mut reasons: Vec<(String, usize)> = reasons.into_iter().collect();
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

#[cfg(test)]
mod tests {
    use super::without_figures;

    #[test]
    fn a_reason_is_told_apart_by_its_words_and_not_by_its_figures() {
        for (reason, words) in [
            (
                "no position on the map fits well enough: confidence 0.3 %; at least 10.4 % is required",
                "no position on the map fits well enough: confidence ... %; at least ... % is required",
            ),
            (
                "one pixel of the photo covers 12 of the map's: check its height",
                "one pixel of the photo covers ... of the map's: check its height",
            ),
            (
                "the perspective of the transform is too strong (3.1e-4 per pixel)",
                "the perspective of the transform is too strong (... per pixel)",
            ),
            (
                "the transform mirrors the photo",
                "the transform mirrors the photo",
            ),
        ] {
            assert_eq!(without_figures(reason), words);
        }
    }
}
