//! RANSAC: the driver. What is fitted is an [`Estimator`]'s business, which points are drawn a [`Sampler`]'s.
//!
//! Fischler & Bolles 1981; adaptive stop after Hartley & Zisserman 2011, algorithm 4.5; local optimisation after Chum, Matas
//! & Kittler 2003; truncated squared errors as the score after Torr & Zisserman 2000 (MSAC).

use crate::{correspondence::Correspondence, sampler::Sampler};

/// Fits a model to a minimal sample and to many pairs.
pub trait Estimator: Sync {
    /// What is fitted.
    type Model: Copy + Send + std::fmt::Debug;
    /// Pairs in a minimal sample.
    const SAMPLE_SIZE: usize;

    /// Fits a minimal sample; none where it is degenerate or mirrors the points.
    fn fit_sample(&self, sample: &[Correspondence]) -> Option<Self::Model>;

    /// Fits any number of pairs by weighted least squares; none where they do not fix a model.
    fn fit_all(&self, pairs: &[Correspondence]) -> Option<Self::Model>;

    /// Squared error of one pair, square pixels; infinite where the model cannot map it.
    fn squared_error(&self, model: &Self::Model, pair: &Correspondence) -> f64;
}

/// How models are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Score {
    /// The number of inliers, as in the original.
    Inliers,
    /// The sum of `1 - error^2 / threshold^2` over the inliers (MSAC).
    Truncated,
}

/// How models are searched.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ransac {
    /// A pair whose error is at most this is an inlier, pixels.
    pub threshold_px: f64,
    /// Samples drawn at most.
    pub max_iterations: usize,
    /// Stop once a sample of inliers only has been drawn with this probability.
    pub confidence: f64,
    /// How models are compared.
    pub score: Score,
    /// Refits each new best model to its inliers before going on.
    pub local_optimisation: bool,
}

impl Ransac {
    /// The paper's: 4 px, at most 1000 iterations, inlier count.
    pub const PAPER: Self = Self {
        threshold_px: 4.0,
        max_iterations: 1000,
        confidence: 0.999,
        score: Score::Inliers,
        local_optimisation: false,
    };
}

/// The best model found.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate<M> {
    /// The model.
    pub model: M,
    /// Indices of the pairs within the threshold, ascending.
    pub inliers: Vec<usize>,
    /// Its score.
    pub score: f64,
    /// Samples drawn.
    pub iterations: usize,
}

/// Rounds of refitting after a new best model.
const LOCAL_ROUNDS: usize = 4;
/// The first round takes pairs within this many thresholds, the last within one.
const LOCAL_REACH: f64 = 2.0;
/// A sampler may draw degenerate samples this many times as often as samples are scored.
const DEGENERATE_DRAWS: usize = 10;

impl Ransac {
    /// Searches the model that most `pairs` agree with; none where no sample gives a model with one inlier more than a sample.
    ///
    /// The same pairs and the same sampler give the same answer.
    pub fn run<E: Estimator>(
        &self,
        estimator: &E,
        pairs: &[Correspondence],
        sampler: &mut dyn Sampler,
    ) -> Option<Estimate<E::Model>> {
        if pairs.len() < E::SAMPLE_SIZE {
            return None;
        }
        let mut drawn = vec![0; E::SAMPLE_SIZE];
        let mut sample = Vec::with_capacity(E::SAMPLE_SIZE);
        let mut best: Option<(E::Model, f64, usize)> = None;
        let mut needed = self.max_iterations;
        let (mut iterations, mut draws) = (0, 0);
        while iterations < needed && draws < DEGENERATE_DRAWS * self.max_iterations {
            draws += 1;
            sampler.draw(pairs.len(), &mut drawn);
            sample.clear();
            sample.extend(drawn.iter().map(|&index| pairs[index]));
            let Some(model) = estimator.fit_sample(&sample) else {
                continue;
            };
            iterations += 1;
            let (score, inliers) = self.rate(estimator, &model, pairs);
            if best.is_some_and(|(_, best_score, _)| score <= best_score) {
                continue;
            }
            let (model, score, inliers) = match self.local_optimisation {
                true => self.optimise(estimator, (model, score, inliers), pairs),
                false => (model, score, inliers),
            };
            best = Some((model, score, inliers));
            needed = self.iterations_needed(inliers, pairs.len(), E::SAMPLE_SIZE);
        }
        let (model, score, inliers) = best?;
        // A sample always fits itself: that alone says nothing.
        if inliers <= E::SAMPLE_SIZE && pairs.len() > E::SAMPLE_SIZE {
            return None;
        }
        Some(Estimate {
            model,
            inliers: self.inliers(estimator, &model, pairs, 1.0),
            score,
            iterations,
        })
    }

    /// Indices of the pairs whose error under `model` is at most `reach` thresholds.
    pub fn inliers<E: Estimator>(
        &self,
        estimator: &E,
        model: &E::Model,
        pairs: &[Correspondence],
        reach: f64,
    ) -> Vec<usize> {
        let limit = (self.threshold_px * reach).powi(2);
        (0..pairs.len())
            .filter(|&index| estimator.squared_error(model, &pairs[index]) <= limit)
            .collect()
    }

    /// Score and inlier count of a model.
    pub fn rate<E: Estimator>(
        &self,
        estimator: &E,
        model: &E::Model,
        pairs: &[Correspondence],
    ) -> (f64, usize) {
        let limit = self.threshold_px.powi(2);
        let (mut score, mut inliers) = (0.0, 0);
        for pair in pairs {
            let squared = estimator.squared_error(model, pair);
            if squared <= limit {
                inliers += 1;
                score += match self.score {
                    Score::Inliers => 1.0,
                    Score::Truncated => 1.0 - squared / limit,
                };
            }
        }
        (score, inliers)
    }

    /// Refits to the pairs within a shrinking distance; keeps what scores best.
    pub fn optimise<E: Estimator>(
        &self,
        estimator: &E,
        start: (E::Model, f64, usize),
        pairs: &[Correspondence],
    ) -> (E::Model, f64, usize) {
        let (mut best, mut model) = (start, start.0);
        let mut chosen = Vec::with_capacity(pairs.len());
        for round in 0..LOCAL_ROUNDS {
            let reach =
                LOCAL_REACH + (1.0 - LOCAL_REACH) * round as f64 / (LOCAL_ROUNDS - 1) as f64;
            let limit = (self.threshold_px * reach).powi(2);
            chosen.clear();
            chosen.extend(
                pairs
                    .iter()
                    .filter(|pair| estimator.squared_error(&model, pair) <= limit),
            );
            let Some(refitted) = estimator.fit_all(&chosen) else {
                break;
            };
            model = refitted;
            let (score, inliers) = self.rate(estimator, &model, pairs);
            if score > best.1 {
                best = (model, score, inliers);
            }
        }
        best
    }

    fn iterations_needed(&self, inliers: usize, pairs: usize, sample_size: usize) -> usize {
        let all_good = (inliers as f64 / pairs as f64).powi(sample_size as i32);
        let needed = (1.0 - self.confidence).ln() / (-all_good).ln_1p();
        if needed.is_finite() {
            (needed.ceil() as usize).clamp(1, self.max_iterations)
        } else if all_good >= 1.0 {
            1
        } else {
            self.max_iterations
        }
    }
}
