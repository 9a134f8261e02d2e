//! The range of each number in a configuration.

use super::TrainConfig;
use crate::data::{HomographyRange, Look};
use crate::error::TrainError;
use std::fmt;

/// Most threads that make pairs: a slip of the keyboard is to be told, and not to stop the machine.
const MOST_DATA_THREADS: usize = 256;
/// Largest side of a view, pixels, for the same reason.
const MOST_SIDE_PX: usize = 4096;
/// Most pairs of a step, likewise.
const MOST_PAIRS: usize = 1 << 16;

/// The values that a setting may have.
#[derive(Clone, Copy)]
enum Range {
    /// A share of something.
    Share,
    /// A share that leaves something.
    BelowOne,
    /// A cosine similarity.
    Similarity,
    Positive,
    /// A limit, which may be none.
    PositiveOrInfinite,
    NotNegative,
    /// A number of things.
    AtLeast(usize),
    /// A number of things, from one number to another.
    FromTo(usize, usize),
}

impl Range {
    fn contains(self, value: f64) -> bool {
        match self {
            Self::Share => (0.0..=1.0).contains(&value),
            Self::BelowOne => (0.0..1.0).contains(&value),
            Self::Similarity => (-1.0..=1.0).contains(&value),
            Self::Positive => value > 0.0 && value.is_finite(),
            Self::PositiveOrInfinite => value > 0.0,
            Self::NotNegative => value >= 0.0 && value.is_finite(),
            Self::AtLeast(least) => value >= least as f64,
            Self::FromTo(least, most) => (least as f64..=most as f64).contains(&value),
        }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Share => f.write_str("between 0 and 1"),
            Self::BelowOne => f.write_str("at least 0 and below 1"),
            Self::Similarity => f.write_str("between -1 and 1"),
            Self::Positive => f.write_str("finite and above 0"),
            Self::PositiveOrInfinite => f.write_str("above 0, or inf"),
            Self::NotNegative => f.write_str("finite and at least 0"),
            Self::AtLeast(least) => write!(f, "at least {least}"),
            Self::FromTo(least, most) => write!(f, "from {least} to {most}"),
        }
    }
}

/// A number: its key, its value and its range.
type Number = (String, f64, Range);

/// Numbers of a table.
fn numbers_of<const N: usize>(table: &str, numbers: [(&str, f64, Range); N]) -> [Number; N] {
    numbers.map(|(key, value, range)| (format!("{table}{key}"), value, range))
}

fn look(table: &str, look: &Look) -> [Number; 14] {
    let shares = [
        ("sat_strength", f64::from(look.sat_strength)),
        ("uav_strength", f64::from(look.uav_strength)),
        ("equalised", look.equalised),
        ("locally_equalised", look.locally_equalised),
        ("shadows", look.shadows),
        ("haze", look.haze),
        ("season", look.season),
        ("jpeg", look.jpeg),
        ("snow", look.snow),
        ("uneven_light", look.uneven_light),
        ("coarse", look.coarse),
        ("rebuilt", look.rebuilt),
        ("filtered", look.filtered),
        ("mixed", look.mixed),
    ];
    numbers_of(table, shares.map(|(key, value)| (key, value, Range::Share)))
}

fn homography(table: &str, range: &HomographyRange) -> [Number; 5] {
    let bounds = [
        ("rotation_deg", range.rotation_deg),
        ("log_scale", range.log_scale),
        ("log_stretch", range.log_stretch),
        ("shift", range.shift),
        ("corner", range.corner),
    ];
    numbers_of(
        table,
        bounds.map(|(key, value)| (key, value, Range::NotNegative)),
    )
}

impl TrainConfig {
    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`TrainError::Config`] with the first that is not.
    pub(super) fn validate_numbers(&self) -> Result<(), TrainError> {
        for (key, value, range) in self.numbers() {
            if !range.contains(value) {
                // Single precision has the digits of the file for both kinds of floats.
                return Err(TrainError::Config {
                    reason: format!("`{key}` is {}; it must be {range}", value as f32),
                });
            }
        }
        Ok(())
    }

    fn numbers(&self) -> Vec<Number> {
        let mut out = Vec::from(self.numbers_of_the_run());
        out.extend(self.numbers_of_the_losses());
        out.extend(look("pairs.look.", &self.pairs.look));
        out.extend(homography("pairs.homography.", &self.pairs.homography));
        if let Some(steps) = self.steps {
            out.push(("steps".into(), steps as f64, Range::AtLeast(1)));
        }
        for (i, folder) in self.data.iter().enumerate() {
            let key = format!("data[{i}].repeat");
            out.push((key, folder.repeat as f64, Range::AtLeast(1)));
        }
        if let Some(teacher) = &self.teacher {
            let weights = [
                ("keypoint", teacher.keypoint),
                ("descriptor", teacher.descriptor),
                ("global", teacher.global),
            ];
            out.extend(numbers_of(
                "teacher.",
                weights.map(|(key, weight)| (key, weight.into(), Range::NotNegative)),
            ));
        }
        if let Some(labels) = &self.labels {
            let numbers = [
                ("views", labels.views as f64, Range::AtLeast(1)),
                (
                    "side_px",
                    labels.side_px.into(),
                    Range::FromTo(1, MOST_SIDE_PX),
                ),
                ("threshold", labels.threshold.into(), Range::Share),
            ];
            out.extend(numbers_of("labels.", numbers));
            out.extend(look("labels.look.", &labels.look));
            out.extend(homography("labels.homography.", &labels.homography));
        }
        out
    }

    fn numbers_of_the_run(&self) -> [Number; 20] {
        use Range::{AtLeast, BelowOne, FromTo, NotNegative, Positive, PositiveOrInfinite, Share};
        let (adam, pairs) = (&self.adam, &self.pairs);
        let numbers = [
            ("world_share", self.world_share, Share),
            ("minutes", self.minutes, Positive),
            (
                "pairs_per_step",
                self.pairs_per_step as f64,
                FromTo(2, MOST_PAIRS),
            ),
            (
                "data_threads",
                self.data_threads as f64,
                FromTo(1, MOST_DATA_THREADS),
            ),
            ("learning_rate", self.learning_rate, Positive),
            ("encoder_rate", self.encoder_rate, NotNegative),
            ("adam.beta1", adam.beta1.into(), BelowOne),
            ("adam.beta2", adam.beta2.into(), BelowOne),
            ("adam.epsilon", adam.epsilon.into(), Positive),
            ("decay_from", self.decay_from, Share),
            ("clip", self.clip.into(), PositiveOrInfinite),
            ("global_from", self.global_from, BelowOne),
            ("average_decay", self.average_decay.into(), BelowOne),
            ("checkpoint_minutes", self.checkpoint_minutes, NotNegative),
            ("validate_minutes", self.validate_minutes, NotNegative),
            ("report_steps", self.report_steps as f64, AtLeast(1)),
            (
                "pairs.side_px",
                pairs.side_px.into(),
                FromTo(1, MOST_SIDE_PX),
            ),
            ("pairs.group", pairs.group as f64, AtLeast(1)),
            ("pairs.points", pairs.points as f64, AtLeast(1)),
            ("pairs.black_corners", pairs.black_corners, Share),
        ];
        numbers_of("", numbers)
    }

    fn numbers_of_the_losses(&self) -> [Number; 18] {
        use Range::{AtLeast, NotNegative, Positive, Similarity};
        let (weights, hinge, triplet) = (&self.weights, &self.hinge, &self.triplet);
        let (multi, homography) = (&self.multi_similarity, &self.homography);
        let numbers = [
            ("weights.keypoint", weights.keypoint, NotNegative),
            ("weights.dustbin", weights.dustbin, NotNegative),
            ("weights.descriptor", weights.descriptor, NotNegative),
            ("weights.global", weights.global, NotNegative),
            ("weights.homography", weights.homography, NotNegative),
            (
                "descriptor_temperature",
                self.descriptor_temperature,
                Positive,
            ),
            ("global_temperature", self.global_temperature, Positive),
            ("hinge.positive_margin", hinge.positive_margin, Similarity),
            ("hinge.negative_margin", hinge.negative_margin, Similarity),
            ("hinge.positive_weight", hinge.positive_weight, NotNegative),
            ("triplet.margin", triplet.margin, NotNegative),
            ("triplet.hardest", triplet.hardest as f32, AtLeast(1)),
            ("multi_similarity.alpha", multi.alpha, Positive),
            ("multi_similarity.beta", multi.beta, Positive),
            ("multi_similarity.threshold", multi.threshold, Similarity),
            (
                "multi_similarity.mining_margin",
                multi.mining_margin,
                NotNegative,
            ),
            ("homography.temperature", homography.temperature, Positive),
            ("homography.unit_px", homography.unit_px, Positive),
        ];
        numbers_of(
            "",
            numbers.map(|(key, value, range)| (key, value.into(), range)),
        )
    }
}
