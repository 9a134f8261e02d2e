//! From matched points to a transform: RANSAC, refinement, and the choice between similarity and homography.

use serde::{Deserialize, Serialize};

use crate::geometry::{
    correspondence::Correspondence,
    homography::{Homography, HomographyEstimator},
    plain_homography::PlainHomographyEstimator,
    ransac::{Estimate, Estimator, Ransac},
    refine::refine,
    sampler::Sampling,
    scale_prior::ScalePrior,
    similarity::{Similarity, SimilarityEstimator},
    transform::Transform,
};

/// The kind of transform from photo to map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GeometryModel {
    /// Rotation, scale and translation only.
    Similarity,
    /// A similarity first; replaced by a homography if that explains clearly more matches.
    SimilarityThenHomography,
    /// A homography from the start.
    Homography,
    /// A homography from the start, without checks, as in the paper: no sample is refused, and the refined homography is kept with the
    /// inliers that it was refined on.
    PlainHomography,
}

/// How a transform is estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimationOptions {
    /// The kind of transform.
    pub model: GeometryModel,
    /// Settings of RANSAC.
    pub ransac: Ransac,
    /// The order in which RANSAC draws samples.
    pub sampling: Sampling,
    /// Seed of the samples that RANSAC draws.
    pub seed: u64,
    /// Whether the transform is refined with each pair weighted by [`Correspondence::weight`].
    pub refine: bool,
    /// Largest scale of a similarity, above 1; its reciprocal is the smallest. Infinite for no limit.
    pub max_scale: f64,
    /// Largest rotation of a similarity in either direction, radians. Infinite for no limit.
    pub max_rotation_rad: f64,
    /// How probable the scales of a similarity are; `None` if all are alike.
    pub scale_prior: Option<ScalePrior>,
}

/// A transform with the pairs that agree with it.
#[derive(Debug, Clone)]
pub struct EstimatedTransform {
    /// The transform.
    pub homography: Homography,
    /// The same transform as a similarity; `None` if it is not one.
    pub similarity: Option<Similarity>,
    /// Indices of the pairs that agree with it, ascending.
    pub inliers: Vec<usize>,
}

impl EstimatedTransform {
    fn of_homography(homography: Homography, inliers: Vec<usize>) -> Self {
        Self {
            homography,
            similarity: None,
            inliers,
        }
    }
}

/// A homography replaces a similarity if it has at least this many times the inliers. It has twice the degrees of freedom and
/// degenerates more easily.
const HOMOGRAPHY_MIN_GAIN_RATIO: f64 = 1.15;
/// A homography replaces a similarity if it has at least this many inliers more.
const HOMOGRAPHY_MIN_GAIN: usize = 4;
/// Pairs within this many thresholds of the similarity are used to start the homography.
const HOMOGRAPHY_START_REACH: f64 = 2.0;

/// Estimates the transform from `pairs`, which are sorted by falling quality. Returns `None` if no transform explains them.
pub fn estimate(
    pairs: &[Correspondence],
    options: &EstimationOptions,
) -> Option<EstimatedTransform> {
    let ransac = &options.ransac;
    let mut sampler = options.sampling.sampler(options.seed);
    let sampler = sampler.as_mut();
    match options.model {
        GeometryModel::PlainHomography => {
            let found = ransac.run(&PlainHomographyEstimator, pairs, sampler)?;
            Some(refined_as_it_is(found, pairs, options))
        }
        GeometryModel::Homography => {
            let estimator = HomographyEstimator::default();
            let found = ransac.run(&estimator, pairs, sampler)?;
            let (homography, inliers) = refined::<8, _>(&estimator, found, pairs, options);
            Some(EstimatedTransform::of_homography(homography, inliers))
        }
        GeometryModel::Similarity | GeometryModel::SimilarityThenHomography => {
            let estimator = similarity_estimator(options);
            let found = ransac.run(&estimator, pairs, sampler)?;
            let (similarity, inliers) = refined::<4, _>(&estimator, found, pairs, options);
            choose_model(similarity, inliers, pairs, options)
        }
    }
}

/// The paper's refinement: the homography of least weighted error over the inliers of RANSAC, which stay the inliers. RANSAC's own
/// homography if refinement is off or the inliers do not determine one.
fn refined_as_it_is(
    found: Estimate<Homography>,
    pairs: &[Correspondence],
    options: &EstimationOptions,
) -> EstimatedTransform {
    let refined = options.refine.then(|| {
        let agreeing: Vec<Correspondence> =
            found.inliers.iter().map(|&index| pairs[index]).collect();
        refine(&found.model, &agreeing)
    });
    let homography = refined
        .flatten()
        .map_or(found.model, |refined| refined.model);
    EstimatedTransform::of_homography(homography, found.inliers)
}

/// Fits the transform of `start` to other `pairs`. A similarity may become a homography. Returns `None` if there is no fit.
pub fn estimate_from(
    start: &EstimatedTransform,
    pairs: &[Correspondence],
    options: &EstimationOptions,
) -> Option<EstimatedTransform> {
    let Some(similarity) = start.similarity else {
        let estimator = HomographyEstimator::default();
        let (homography, inliers) = refit::<8, _>(&estimator, start.homography, pairs, options);
        return Some(EstimatedTransform::of_homography(homography, inliers));
    };
    let estimator = similarity_estimator(options);
    let (similarity, inliers) = refit::<4, _>(&estimator, similarity, pairs, options);
    choose_model(similarity, inliers, pairs, options)
}

fn similarity_estimator(options: &EstimationOptions) -> SimilarityEstimator {
    SimilarityEstimator {
        scale_range: (1.0 / options.max_scale, options.max_scale),
        max_rotation_rad: options.max_rotation_rad,
        scale_prior: options.scale_prior,
        ..SimilarityEstimator::default()
    }
}

/// The homography near this similarity if it explains enough more pairs and is allowed, else the similarity.
fn choose_model(
    similarity: Similarity,
    inliers: Vec<usize>,
    pairs: &[Correspondence],
    options: &EstimationOptions,
) -> Option<EstimatedTransform> {
    let by_similarity = EstimatedTransform {
        homography: Homography::of(&similarity)?,
        similarity: Some(similarity),
        inliers,
    };
    if options.model == GeometryModel::Similarity {
        return Some(by_similarity);
    }
    // Pairs that the similarity nearly explains are those that show a perspective.
    let estimator = HomographyEstimator::default();
    let near: Vec<Correspondence> = options
        .ransac
        .inliers(
            &estimator,
            &by_similarity.homography,
            pairs,
            HOMOGRAPHY_START_REACH,
        )
        .into_iter()
        .map(|index| pairs[index])
        .collect();
    let start = Homography::fit(&near).unwrap_or(by_similarity.homography);
    let (homography, inliers) = refit::<8, _>(&estimator, start, pairs, options);
    let count = by_similarity.inliers.len();
    let needed =
        (count as f64 * HOMOGRAPHY_MIN_GAIN_RATIO).max((count + HOMOGRAPHY_MIN_GAIN) as f64);
    if inliers.len() as f64 >= needed {
        Some(EstimatedTransform::of_homography(homography, inliers))
    } else {
        Some(by_similarity)
    }
}

/// Fits a transform to the pairs near `start`; returns it with the indices of its inliers.
fn refit<const N: usize, E: Estimator>(
    estimator: &E,
    start: E::Model,
    pairs: &[Correspondence],
    options: &EstimationOptions,
) -> (E::Model, Vec<usize>)
where
    E::Model: Transform<N>,
{
    let ransac = &options.ransac;
    let scored = ransac.score_model(estimator, &start, pairs);
    let best = ransac.optimise(estimator, scored, pairs);
    let found = Estimate {
        inliers: ransac.inliers(estimator, &best.model, pairs, 1.0),
        model: best.model,
        score: best.score,
        iterations: 0,
    };
    refined::<N, _>(estimator, found, pairs, options)
}

/// The refined transform with the indices of its inliers; the transform as found if refinement loses more than a tenth of them.
fn refined<const N: usize, E: Estimator>(
    estimator: &E,
    found: Estimate<E::Model>,
    pairs: &[Correspondence],
    options: &EstimationOptions,
) -> (E::Model, Vec<usize>)
where
    E::Model: Transform<N>,
{
    if !options.refine {
        return (found.model, found.inliers);
    }
    let agreeing: Vec<Correspondence> = found.inliers.iter().map(|&index| pairs[index]).collect();
    let Some(refined) = refine(&found.model, &agreeing) else {
        return (found.model, found.inliers);
    };
    let inliers = options
        .ransac
        .inliers(estimator, &refined.model, pairs, 1.0);
    // A weighted fit may give up many weak pairs for a few strong ones.
    if inliers.len() * 10 >= found.inliers.len() * 9 {
        (refined.model, inliers)
    } else {
        (found.model, found.inliers)
    }
}
