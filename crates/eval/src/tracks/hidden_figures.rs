//! Figures of predictions of hidden fixes.

use serde::Serialize;

use super::figures::Consistency;
use super::hidden::{MOST_HIDDEN, Prediction};
use crate::metrics::statistics::percentile;

/// Figures for one number of hidden fixes.
#[derive(Debug, Clone, Serialize)]
pub struct HiddenFigures {
    /// Fixes hidden in a row.
    pub hidden: usize,
    /// Predictions.
    pub predictions: usize,
    /// Predictions over photos that were all joined by motion.
    pub joined: usize,
    /// Median distance flown, metres.
    pub distance_median_m: Option<f64>,
    /// Median error of the last fix held, metres.
    pub fixes_only_median_m: Option<f64>,
    /// Median error of the motion alone, where all photos were joined, metres.
    pub motion_only_median_m: Option<f64>,
    /// Share of predictions with a usable position of the filter.
    pub answered: f64,
    /// Median error of the filter, metres.
    pub filter_median_m: Option<f64>,
    /// Median error of the filter where all photos were joined, metres.
    pub filter_joined_median_m: Option<f64>,
    /// 90th percentile of it where all photos were joined, metres.
    pub filter_joined_p90_m: Option<f64>,
    /// Median stated radius, metres.
    pub radius95_median_m: Option<f64>,
    /// Squared normalised errors of the filter.
    pub nees: Option<Consistency>,
}

/// The figures by number of hidden fixes.
#[must_use]
pub fn figures(predictions: &[Prediction]) -> Vec<HiddenFigures> {
    (1..=MOST_HIDDEN)
        .map(|hidden| {
            let of: Vec<&Prediction> = predictions.iter().filter(|p| p.hidden == hidden).collect();
            let values = |value: &dyn Fn(&Prediction) -> Option<f64>| -> Vec<f64> {
                of.iter().filter_map(|p| value(p)).collect()
            };
            let median =
                |value: &dyn Fn(&Prediction) -> Option<f64>| percentile(&values(value), 0.5);
            let joined = |p: &Prediction| p.filter_m.filter(|_| p.joined);
            let answers = values(&|p| p.filter_m);
            HiddenFigures {
                hidden,
                predictions: of.len(),
                joined: of.iter().filter(|p| p.joined).count(),
                distance_median_m: median(&|p| Some(p.distance_m)),
                fixes_only_median_m: median(&|p| p.last_fix_m),
                motion_only_median_m: median(&|p| p.motion_only_m),
                answered: answers.len() as f64 / of.len().max(1) as f64,
                filter_median_m: percentile(&answers, 0.5),
                filter_joined_median_m: median(&joined),
                filter_joined_p90_m: percentile(&values(&joined), 0.9),
                radius95_median_m: median(&|p| p.radius95_m),
                nees: Consistency::of(&values(&|p| p.nees)),
            }
        })
        .collect()
}
