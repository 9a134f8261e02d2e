//! Figures of a model on held-out pairs, measured with the inference engine.

use crate::data::{Mapping, Pair, PairOptions, Source};
use crate::error::TrainError;
use crate::measure::pair_figures::pair_figures;
use grimnet_net::{Domain, ExtractOptions, Extractor, Features, Model};
use image::GrayImage;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;

/// Figures on held-out pairs; shares are 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Pairs measured.
    pub pairs: usize,
    /// Keypoint and matching figures; `None` for pairs without known corresponding points.
    pub matching: Option<MatchingFigures>,
    /// Recall@1 and recall@5: share of photos whose place is among the most similar views of the gallery.
    pub recall: [f64; 2],
    /// Views in the gallery.
    pub gallery: usize,
}

/// Keypoint and matching figures; shares are 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MatchingFigures {
    /// Share of the keypoints in the area that both views see which the other view has, too, within 3 px.
    pub repeatability: f64,
    /// Correct matches (mutual nearest neighbours within 3 px) per keypoint of that area.
    pub matching_score: f64,
    /// Share of matches that are correct.
    pub match_precision: f64,
    /// Share of pairs whose estimated homography has a mean corner error below 1, 3 and 5 px.
    pub homography_accuracy: [f64; 3],
}

/// Figures by the name of the held-out data.
pub type Validations = Vec<(String, Validation)>;

/// Corresponding points that the views of a pair must have. The figures do not use them, so that few are enough.
const POINTS: usize = 32;

/// Options of the pairs for validation and for fitting the whitening: like those of training, with few points.
pub fn validation_options(training: &PairOptions) -> PairOptions {
    PairOptions {
        points: training.points.min(POINTS),
        ..training.clone()
    }
}

/// `count` pairs of a source, or fewer if it gives no more.
pub fn pairs_of(source: &dyn Source, count: usize, options: &PairOptions, seed: u64) -> Vec<Pair> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut out = Vec::with_capacity(count);
    let mut empty = 0;
    while out.len() < count && empty < 20 {
        let group = source.group(options.group.min(count - out.len()), options, &mut random);
        empty = if group.is_empty() { empty + 1 } else { 0 };
        out.extend(group);
    }
    out
}

/// The mask of a photo: 255 in cells inside the picture.
fn mask_of(pair: &Pair) -> GrayImage {
    let side = pair.uav.width();
    GrayImage::from_fn(side, side, |x, y| {
        let cell = ((y / 8) * (side / 8) + x / 8) as usize;
        image::Luma([if pair.uav_seen[cell] { 255 } else { 0 }])
    })
}

/// Features of both views of a pair.
///
/// # Errors
/// Returns an error if the network cannot process the pictures.
pub(super) fn features_of(
    pair: &Pair,
    extractors: &[Extractor; 2],
    options: &ExtractOptions,
) -> Result<[Features; 2], TrainError> {
    let sat = extractors[0].extract(&pair.sat, None, options)?;
    let uav = extractors[1].extract(&pair.uav, Some(&mask_of(pair)), options)?;
    Ok([sat, uav])
}

/// Extractors of both domains.
///
/// # Errors
/// Returns an error if the model cannot be run.
pub(super) fn extractors_of(model: &Model) -> Result<[Extractor; 2], TrainError> {
    Ok([
        Extractor::new(model, Domain::Sat)?,
        Extractor::new(model, Domain::Uav)?,
    ])
}

/// The outputs of a model for pairs that [`Validation`] is computed from. The network runs once for several whitenings.
#[derive(Clone, Debug)]
pub struct PairOutputs {
    /// Number of pairs.
    pairs: usize,
    matching: Option<MatchingFigures>,
    /// Global descriptors of the map views and of the photos, row by row.
    globals: [Vec<f32>; 2],
    /// Their length.
    length: usize,
}

impl PairOutputs {
    /// Runs the model on pairs and calls `on_pair` after each.
    ///
    /// # Errors
    /// Returns an error if the network cannot process the pictures.
    pub fn of(
        model: &Model,
        pairs: &[Pair],
        on_pair: &mut dyn FnMut(),
    ) -> Result<Self, TrainError> {
        let extractors = extractors_of(model)?;
        let options = ExtractOptions {
            max_keypoints: 512,
            ..ExtractOptions::default()
        };
        let mut out = MatchingFigures::default();
        let mut with_points = 0usize;
        let [mut sat_globals, mut uav_globals] = [const { Vec::new() }; 2];
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let (mut correct, mut matched) = (0usize, 0usize);
        for pair in pairs {
            let [sat, uav] = features_of(pair, &extractors, &options)?;
            if !matches!(pair.mapping, Mapping::Unknown) {
                let figures = pair_figures(pair, &sat, &uav, &mut random);
                with_points += 1;
                out.repeatability += figures.repeatability;
                out.matching_score += figures.matching_score;
                correct += figures.correct;
                matched += figures.matched;
                for (sum, bound) in out.homography_accuracy.iter_mut().zip([1.0, 3.0, 5.0]) {
                    *sum += f64::from(u8::from(figures.corner_error_px < bound));
                }
            }
            sat_globals.extend(sat.global);
            uav_globals.extend(uav.global);
            on_pair();
        }
        let n = with_points.max(1) as f64;
        out.repeatability /= n;
        out.matching_score /= n;
        out.match_precision = correct as f64 / matched.max(1) as f64;
        out.homography_accuracy.iter_mut().for_each(|v| *v /= n);
        Ok(Self {
            pairs: pairs.len(),
            matching: (with_points > 0).then_some(out),
            globals: [sat_globals, uav_globals],
            length: model.spec().global_len(),
        })
    }

    /// The figures. The gallery consists of the map views of `pairs`, which must be the pairs that the model was run on, and of
    /// `distractors` (global descriptors, row by row).
    pub fn validation(&self, pairs: &[Pair], distractors: &[f32]) -> Validation {
        let ([sat, uav], length) = (&self.globals, self.length);
        let gallery = [sat.as_slice(), distractors].concat();
        let mut out = Validation {
            gallery: gallery.len() / length,
            pairs: self.pairs,
            matching: self.matching,
            recall: [0.0; 2],
        };
        for (i, query) in uav.chunks_exact(length).enumerate() {
            let dot = |row: &[f32]| row.iter().zip(query).map(|(a, b)| a * b).sum::<f32>();
            let similarities: Vec<f32> = gallery.chunks_exact(length).map(dot).collect();
            let own = similarities[i];
            // A view that overlaps the place is neither found nor a rival.
            let is_elsewhere = |j: usize| {
                let other = pairs.get(j);
                other.is_none_or(|other| other.place.overlap(&pairs[i].place) < 0.3)
            };
            // One that is as similar, or no number, counts against the network: equal descriptors distinguish nothing.
            let rivals = similarities
                .iter()
                .enumerate()
                .filter(|(j, s)| s.partial_cmp(&&own) != Some(Ordering::Less) && is_elsewhere(*j))
                .count();
            for (sum, within) in out.recall.iter_mut().zip([1, 5]) {
                let is_found = rivals < within && !own.is_nan();
                *sum += f64::from(u8::from(is_found)) / pairs.len() as f64;
            }
        }
        out
    }

    /// The same with the whitening of `model`, which must not differ otherwise from the model that was run.
    #[must_use]
    pub fn whitened(&self, model: &Model) -> Self {
        Self {
            globals: self.globals.clone().map(|rows| model.whitened(rows)),
            length: model.spec().global_len(),
            pairs: self.pairs,
            matching: self.matching,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Place;
    use image::RgbImage;
    use nalgebra::Matrix3;

    /// Recall of eight places without distractors, with these descriptors of the map views and the photos.
    fn recall(sat: [[f32; 2]; 8], uav: [[f32; 2]; 8]) -> [f64; 2] {
        let pair = |picture| Pair {
            sat: RgbImage::new(8, 8),
            uav: RgbImage::new(8, 8),
            uav_seen: vec![true],
            sat_labels: vec![0],
            uav_labels: vec![0],
            sat_points: Vec::new(),
            uav_points: Vec::new(),
            uav_from_sat_px: Matrix3::identity(),
            mapping: Mapping::Unknown,
            place: Place {
                picture,
                window: [0.0, 0.0, 1.0, 1.0],
            },
            scene: None,
        };
        let outputs = PairOutputs {
            pairs: 8,
            matching: None,
            globals: [sat.concat(), uav.concat()],
            length: 2,
        };
        let pairs: Vec<Pair> = (0..8).map(pair).collect();
        outputs.validation(&pairs, &[]).recall
    }

    #[test]
    fn descriptors_that_distinguish_nothing_find_nothing() {
        let turned = std::array::from_fn(|i| {
            let (sin, cos) = (i as f32).sin_cos();
            [cos, sin]
        });
        assert_eq!(recall(turned, turned), [1.0, 1.0]);
        let collapsed = [[0.6, 0.8]; 8];
        assert_eq!(recall(collapsed, collapsed), [0.0, 0.0]);
        assert_eq!(recall([[f32::NAN; 2]; 8], turned), [0.0, 0.0]);
        assert_eq!(recall(turned, [[f32::NAN; 2]; 8]), [0.0, 0.0]);
    }
}
