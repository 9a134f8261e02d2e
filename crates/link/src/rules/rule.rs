//! What a parameter should be.

use std::{collections::BTreeMap, fmt};

/// The least noise of one position that an EKF should assume, metres: the map's own error.
pub(crate) const MIN_NOISE_M: f64 = 1.0;
/// The greatest, metres: with more, a fix has no weight.
pub(crate) const MAX_NOISE_M: f64 = 10.0;
/// The usual one, metres: an error of 1.5 m, times the square root of ten messages for each fix (docs/autopilot.md).
pub(crate) const USUAL_NOISE_M: f64 = 5.0;
/// Why.
pub(crate) const NOISE_REASON: &str = "metres: positions between two fixes share their error, so each must count for less than its covariance says";

/// What a parameter should be, and why.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rule {
    /// Its name, and names that it had before.
    names: &'static [&'static str],
    wanted: Wanted,
    /// Whether positions are not taken, or taken wrongly, with another value; else it is advice.
    needed: bool,
    /// Which alternative of the autopilot's settings it belongs to. `None`: all.
    group: Option<u8>,
    reason: &'static str,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Wanted {
    Value(f64),
    /// Lowest, highest, and what to set.
    Within(f64, f64, f64),
}

impl Rule {
    /// The parameter has to have this value.
    pub const fn value(names: &'static [&'static str], value: f64, reason: &'static str) -> Self {
        Self {
            names,
            wanted: Wanted::Value(value),
            needed: true,
            group: None,
            reason,
        }
    }

    /// The parameter has to be in a range; `usual` is what to set.
    pub const fn within(
        names: &'static [&'static str],
        lowest: f64,
        highest: f64,
        usual: f64,
        reason: &'static str,
    ) -> Self {
        Self {
            names,
            wanted: Wanted::Within(lowest, highest, usual),
            needed: true,
            group: None,
            reason,
        }
    }

    /// Positions are taken with other values too.
    pub const fn advice(self) -> Self {
        Self {
            needed: false,
            ..self
        }
    }

    /// It matters only if this alternative is chosen.
    pub const fn of_group(self, group: u8) -> Self {
        Self {
            group: Some(group),
            ..self
        }
    }

    pub fn names(&self) -> &'static [&'static str] {
        self.names
    }

    /// Compares it with the values that were read.
    pub fn finding(&self, values: &BTreeMap<String, f64>) -> Finding {
        let known = self
            .names
            .iter()
            .find_map(|name| Some((*name, *values.get(*name)?)));
        let found = known.map(|(_, value)| value);
        let (expected, set_to, right) = match self.wanted {
            Wanted::Value(wanted) => (
                format!("{wanted}"),
                wanted,
                found.is_some_and(|value| (value - wanted).abs() < 1e-6),
            ),
            Wanted::Within(lowest, highest, usual) => (
                format!("{lowest} to {highest}"),
                usual,
                found.is_some_and(|value| (lowest..=highest).contains(&value)),
            ),
        };
        let verdict = match (found, right, self.needed) {
            (None, ..) => Verdict::Missing,
            (_, true, _) => Verdict::Right,
            (_, false, true) => Verdict::Wrong,
            (_, false, false) => Verdict::Advice,
        };
        Finding {
            parameter: known.map_or_else(
                || self.names.first().copied().unwrap_or_default(),
                |(name, _)| name,
            ),
            found,
            expected,
            set_to,
            verdict,
            needed: self.needed,
            reason: self.reason,
        }
    }
}

/// The values that were read, and the alternative that the autopilot is set to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chosen<'a> {
    pub values: &'a BTreeMap<String, f64>,
    pub group: u8,
}

impl Chosen<'_> {
    /// Whether the rule matters.
    pub fn concerns(&self, rule: &Rule) -> bool {
        rule.group.is_none_or(|group| group == self.group)
    }
}

/// How a parameter stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// As it should be.
    Right,
    /// Positions are not taken, or taken wrongly.
    Wrong,
    /// It works, not as well as it could.
    Advice,
    /// The autopilot does not know the parameter, or did not answer.
    Missing,
}

/// One parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// Its name.
    pub parameter: &'static str,
    /// Its value.
    pub found: Option<f64>,
    /// What it should be.
    pub expected: String,
    /// The value to set where it is something else.
    pub set_to: f64,
    /// How it stands.
    pub verdict: Verdict,
    /// Whether positions are not taken, or taken wrongly, with another value.
    pub needed: bool,
    /// What it does.
    pub reason: &'static str,
}

impl Finding {
    /// Whether positions are not taken, or taken wrongly, as it is.
    #[must_use]
    pub fn must_change(&self) -> bool {
        self.needed && self.verdict != Verdict::Right
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Right => "ok",
            Self::Wrong => "change",
            Self::Advice => "advice",
            Self::Missing => "missing",
        })
    }
}
