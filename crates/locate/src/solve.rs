//! From matched points to a transform: RANSAC, refinement, and the choice between similarity and homography.

use crate::{
    correspondence::Correspondence,
    homography::{Homography, HomographyEstimator},
    options::{GeometryModel, Options},
    ransac::{Estimate, Estimator},
    refine::refine,
    sampler::Progressive,
    similarity::{Similarity, SimilarityEstimator},
    transform::Transform,
};

/// Limits on the similarity that hypotheses of heading and scale set.
#[derive(Debug, Clone, Copy)]
pub struct Expected {
    /// Largest rotation between query and map, radians.
    pub max_rotation_rad: f64,
}

/// A transform that explains some of the pairs.
#[derive(Debug, Clone)]
pub struct Solved {
    /// The transform.
    pub homography: Homography,
    /// The same where it is a similarity.
    pub similarity: Option<Similarity>,
    /// Indices of the pairs that agree with it.
    pub inliers: Vec<usize>,
}

/// A homography must explain this many more matches than a similarity to be taken, relative and absolute: it has twice the
/// freedom and degenerates more.
const HOMOGRAPHY_GAIN: (f64, usize) = (1.15, 4);

/// Finds the transform from matched points, best first, as `options` have it: kind, RANSAC, refinement, limits of scale.
///
/// None where no transform explains any pairs.
pub fn solve(pairs: &[Correspondence], expected: Expected, options: &Options) -> Option<Solved> {
    let ransac = &options.ransac;
    if options.geometry == GeometryModel::Homography {
        let estimator = HomographyEstimator::default();
        let found = ransac.run(&estimator, pairs, &mut Progressive::new(options.seed))?;
        let (homography, inliers) = settle::<8, _>(&estimator, found, pairs, options);
        return Some(Solved {
            homography,
            similarity: None,
            inliers,
        });
    }
    let estimator = similarity_estimator(expected, options);
    let found = ransac.run(&estimator, pairs, &mut Progressive::new(options.seed))?;
    let (similarity, inliers) = settle::<4, _>(&estimator, found, pairs, options);
    perhaps_homography(similarity, inliers, pairs, options)
}

/// The transform of `start` fitted to other `pairs`, its kind decided anew where it was a similarity; `None` where there is no such
/// fit.
pub fn solve_from(
    start: &Solved,
    pairs: &[Correspondence],
    expected: Expected,
    options: &Options,
) -> Option<Solved> {
    let Some(similarity) = start.similarity else {
        let estimator = HomographyEstimator::default();
        let (homography, inliers) = adjust::<8, _>(&estimator, start.homography, pairs, options);
        return Some(Solved {
            homography,
            similarity: None,
            inliers,
        });
    };
    let estimator = similarity_estimator(expected, options);
    let (similarity, inliers) = adjust::<4, _>(&estimator, similarity, pairs, options);
    perhaps_homography(similarity, inliers, pairs, options)
}

fn similarity_estimator(expected: Expected, options: &Options) -> SimilarityEstimator {
    let max_scale = options
        .gates
        .map_or(f64::INFINITY, |gates| 1.0 + gates.max_scale_change);
    SimilarityEstimator {
        scale_range: (1.0 / max_scale, max_scale),
        max_rotation_rad: expected.max_rotation_rad,
        ..SimilarityEstimator::default()
    }
}

/// The homography near this similarity where it explains enough more and may be taken, else the similarity.
fn perhaps_homography(
    similarity: Similarity,
    inliers: Vec<usize>,
    pairs: &[Correspondence],
    options: &Options,
) -> Option<Solved> {
    let plain = Solved {
        homography: Homography::of(&similarity)?,
        similarity: Some(similarity),
        inliers,
    };
    if options.geometry == GeometryModel::Similarity {
        return Some(plain);
    }
    // Pairs that the similarity nearly explains are where a perspective would show.
    let estimator = HomographyEstimator::default();
    let near: Vec<Correspondence> = options
        .ransac
        .inliers(&estimator, &plain.homography, pairs, 2.0)
        .into_iter()
        .map(|index| pairs[index])
        .collect();
    let start = Homography::fit(&near).unwrap_or(plain.homography);
    let (homography, inliers) = adjust::<8, _>(&estimator, start, pairs, options);
    let needed = (plain.inliers.len() as f64 * HOMOGRAPHY_GAIN.0)
        .max((plain.inliers.len() + HOMOGRAPHY_GAIN.1) as f64);
    if inliers.len() as f64 >= needed {
        Some(Solved {
            homography,
            similarity: None,
            inliers,
        })
    } else {
        Some(plain)
    }
}

/// The transform fitted to the pairs about `start`, and those that agree.
fn adjust<const N: usize, E: Estimator>(
    estimator: &E,
    start: E::Model,
    pairs: &[Correspondence],
    options: &Options,
) -> (E::Model, Vec<usize>)
where
    E::Model: Transform<N>,
{
    let ransac = &options.ransac;
    let (score, count) = ransac.rate(estimator, &start, pairs);
    let (model, score, _) = ransac.optimise(estimator, (start, score, count), pairs);
    let found = Estimate {
        inliers: ransac.inliers(estimator, &model, pairs, 1.0),
        model,
        score,
        iterations: 0,
    };
    settle::<N, _>(estimator, found, pairs, options)
}

/// The refined transform and its inliers; what was found where refinement loses some.
fn settle<const N: usize, E: Estimator>(
    estimator: &E,
    found: Estimate<E::Model>,
    pairs: &[Correspondence],
    options: &Options,
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
    // A weighted fit may trade a few strong pairs for many weak ones.
    if inliers.len() * 10 >= found.inliers.len() * 9 {
        (refined.model, inliers)
    } else {
        (found.model, found.inliers)
    }
}
