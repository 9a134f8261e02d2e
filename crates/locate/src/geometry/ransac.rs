//! RANSAC with local optimisation.
//!
//! Fischler & Bolles 1981; adaptive stop after Hartley & Zisserman 2004, algorithm 4.5; local optimisation after Chum, Matas
//! & Kittler 2003; truncated squared errors as the score after Torr & Zisserman 2000 (MSAC). The model is an [`Estimator`],
//! the order of the samples a [`Sampler`].
//!
//! # Residuals
//! The residual of a pair is the Euclidean distance between the mapped point and the matched point, in pixels of the picture
//! that is mapped to. [`Ransac::threshold_px`] is compared with this distance; it is not squared and not normalised.
//!
//! # Stop
//! With `w` the share of inliers of the best model so far (times [`Estimator::prior_weight`]), `s` the sample size and `p` [`Ransac::confidence`], the search ends
//! after `N = ln(1 - p) / ln(1 - w^s)` scored samples, or after [`Ransac::max_iterations`].
//!
//! # Degenerate samples
//! A sample for which [`Estimator::fit_sample`] returns `None` is not scored and not counted as an iteration; at most ten times
//! `max_iterations` samples are drawn in total.

use crate::geometry::{correspondence::Correspondence, sampler::Sampler};

/// Fits a model to a minimal sample and to many pairs.
pub trait Estimator: Sync {
    /// The fitted model.
    type Model: Copy + Send + std::fmt::Debug;
    /// Number of pairs in a minimal sample.
    const SAMPLE_SIZE: usize;

    /// Fits a minimal sample. Returns `None` if the sample is degenerate, or for another reason that the estimator names, such as a
    /// model that mirrors the points.
    fn fit_sample(&self, sample: &[Correspondence]) -> Option<Self::Model>;

    /// Fits any number of pairs by weighted least squares. Returns `None` if the pairs do not determine a model.
    fn fit_all(&self, pairs: &[Correspondence]) -> Option<Self::Model>;

    /// Squared residual of one pair, square pixels; infinite if the model cannot map the point.
    fn squared_error(&self, model: &Self::Model, pair: &Correspondence) -> f64;

    /// Factor on the model's score, 0 to 1, by how probable the model is before any pair is looked at.
    fn prior_weight(&self, _model: &Self::Model) -> f64 {
        1.0
    }
}

/// How two models are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Score {
    /// The number of inliers, as in the original publication.
    Inliers,
    /// The sum of `1 - residual^2 / threshold^2` over the inliers (MSAC).
    Truncated,
}

/// Settings of the search.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ransac {
    /// Pairs with a residual of at most this are inliers, pixels of the picture that is mapped to.
    pub threshold_px: f64,
    /// Maximum number of scored samples.
    pub max_iterations: usize,
    /// Probability of having drawn at least one sample without outliers at which the search ends, above 0, at most 1. With 1 it ends
    /// early only if all pairs are inliers.
    pub confidence: f64,
    /// How two models are compared.
    pub score: Score,
    /// Refits each new best model to its inliers before the search goes on.
    pub local_optimisation: bool,
    /// Whether a model must have more inliers than its own sample, which it always fits.
    pub needs_support: bool,
}

impl Ransac {
    /// The paper's settings: 4 px, 1000 iterations, inlier count, and four inliers are enough.
    pub const PAPER: Self = Self {
        threshold_px: 4.0,
        max_iterations: 1000,
        confidence: 1.0,
        score: Score::Inliers,
        local_optimisation: false,
        needs_support: false,
    };
}

/// A model with its score over all pairs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoredModel<M> {
    /// The model.
    pub model: M,
    /// Its score, see [`Score`] and [`Estimator::prior_weight`].
    pub score: f64,
    /// Number of pairs within the threshold.
    pub inlier_count: usize,
}

/// The best model found.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate<M> {
    /// The model.
    pub model: M,
    /// Indices of the pairs within the threshold, ascending.
    pub inliers: Vec<usize>,
    /// Its score, see [`Score`].
    pub score: f64,
    /// Number of scored samples.
    pub iterations: usize,
}

/// Rounds of refitting after a new best model.
const LOCAL_ROUNDS: usize = 4;
/// The first round of refitting uses pairs within this many thresholds, the last round within one threshold.
const LOCAL_REACH: f64 = 2.0;
/// Samples drawn at most, degenerate ones included, as a multiple of `max_iterations`.
const MAX_DRAWS_PER_ITERATION: usize = 10;

impl Ransac {
    /// Returns the model with the best score over `pairs`, or `None` if no sample has a model, or, with
    /// [`Ransac::needs_support`], every model fits its own sample only.
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
        let mut best: Option<ScoredModel<E::Model>> = None;
        let mut needed = self.max_iterations;
        let (mut iterations, mut draws) = (0, 0);
        while iterations < needed
            && draws < MAX_DRAWS_PER_ITERATION.saturating_mul(self.max_iterations)
        {
            draws += 1;
            sampler.draw(pairs.len(), &mut drawn);
            sample.clear();
            sample.extend(drawn.iter().map(|&index| pairs[index]));
            let Some(model) = estimator.fit_sample(&sample) else {
                continue;
            };
            iterations += 1;
            let mut scored = self.score_model(estimator, &model, pairs);
            if best.is_some_and(|best| scored.score <= best.score) {
                continue;
            }
            if self.local_optimisation {
                scored = self.optimise(estimator, scored, pairs);
            }
            best = Some(scored);
            // A model that is more probable wins with fewer inliers, and must have been drawn as well.
            let enough = scored.inlier_count as f64 * estimator.prior_weight(&scored.model);
            needed = self.iterations_needed(enough / pairs.len() as f64, E::SAMPLE_SIZE);
        }
        let best = best?;
        // A model always fits its own sample, so further inliers are needed as support.
        let is_supported = best.inlier_count > E::SAMPLE_SIZE || pairs.len() == E::SAMPLE_SIZE;
        if self.needs_support && !is_supported {
            return None;
        }
        Some(Estimate {
            model: best.model,
            inliers: self.inliers(estimator, &best.model, pairs, 1.0),
            score: best.score,
            iterations,
        })
    }

    /// Indices of the pairs whose residual under `model` is at most `thresholds` times the threshold.
    pub fn inliers<E: Estimator>(
        &self,
        estimator: &E,
        model: &E::Model,
        pairs: &[Correspondence],
        thresholds: f64,
    ) -> Vec<usize> {
        let limit_px2 = (self.threshold_px * thresholds).powi(2);
        (0..pairs.len())
            .filter(|&index| estimator.squared_error(model, &pairs[index]) <= limit_px2)
            .collect()
    }

    /// Scores a model over all pairs.
    pub fn score_model<E: Estimator>(
        &self,
        estimator: &E,
        model: &E::Model,
        pairs: &[Correspondence],
    ) -> ScoredModel<E::Model> {
        let limit_px2 = self.threshold_px.powi(2);
        let (mut score, mut inlier_count) = (0.0, 0);
        for pair in pairs {
            let squared_px2 = estimator.squared_error(model, pair);
            if squared_px2 <= limit_px2 {
                inlier_count += 1;
                score += match self.score {
                    Score::Inliers => 1.0,
                    Score::Truncated => 1.0 - squared_px2 / limit_px2,
                };
            }
        }
        ScoredModel {
            model: *model,
            score: score * estimator.prior_weight(model),
            inlier_count,
        }
    }

    /// Refits the model to the pairs within a shrinking distance and returns the best-scoring model, `start` included.
    pub fn optimise<E: Estimator>(
        &self,
        estimator: &E,
        start: ScoredModel<E::Model>,
        pairs: &[Correspondence],
    ) -> ScoredModel<E::Model> {
        let (mut best, mut model) = (start, start.model);
        let mut chosen = Vec::with_capacity(pairs.len());
        for round in 0..LOCAL_ROUNDS {
            let reach =
                LOCAL_REACH + (1.0 - LOCAL_REACH) * round as f64 / (LOCAL_ROUNDS - 1) as f64;
            let limit_px2 = (self.threshold_px * reach).powi(2);
            chosen.clear();
            chosen.extend(
                pairs
                    .iter()
                    .filter(|pair| estimator.squared_error(&model, pair) <= limit_px2),
            );
            let Some(refitted) = estimator.fit_all(&chosen) else {
                break;
            };
            model = refitted;
            let scored = self.score_model(estimator, &model, pairs);
            if scored.score > best.score {
                best = scored;
            }
        }
        best
    }

    /// `ln(1 - p) / ln(1 - w^s)`, see the module documentation.
    fn iterations_needed(&self, share: f64, sample_size: usize) -> usize {
        let all_good = share.powi(sample_size as i32);
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
