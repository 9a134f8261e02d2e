//! Whether the matches that agree are a motion: waves and traffic give many matches, of which a few agree by chance or move together.

use nalgebra::Point2;

use super::levelling::NOWHERE;
use crate::geometry::{
    correspondence::Correspondence, homography::Homography, transform::Transform as _,
};

/// Fewer matches than this that agree are no motion: with the thousands of pairs of two photos, a dozen can agree by chance.
pub(crate) const LEAST_INLIERS: usize = 16;
/// At least this share of the matches on common ground must agree. Waves and traffic give many matches of which few agree, and
/// those few move with the waves.
const LEAST_INLIER_SHARE: f64 = 0.2;
/// Similarities between two photos that can be told apart: hundreds of places in each direction, of turns and a few of scales.
const DISTINCT_SIMILARITIES: f64 = 1e7;
/// Expected number of pairs of photos without common ground that are taken for a motion, at most.
const MOST_FALSE_ALARMS: f64 = 1e-3;
/// Waves and traffic look alike, so that descriptors agree by chance more often than in random order by about this factor.
const ALIKE: f64 = 4.0;

/// Whether `agreeing` of the `pairs` are a motion along `transform`, where `chance` would agree if descriptors said nothing.
pub(crate) fn is_motion(
    agreeing: usize,
    chance: f64,
    transform: &Homography,
    pairs: &[Correspondence],
    first_points: &[Point2<f64>],
) -> bool {
    let could_agree = on_common_ground(transform, pairs, first_points);
    agreeing >= LEAST_INLIERS
        && ln_false_alarms(agreeing, ALIKE * chance) <= MOST_FALSE_ALARMS.ln()
        && agreeing as f64 >= LEAST_INLIER_SHARE * could_agree as f64
}

/// Pairs whose keypoint of the second photo the transform puts into the first photo, as far as that has keypoints: the others
/// cannot agree.
fn on_common_ground(
    transform: &Homography,
    pairs: &[Correspondence],
    first_points: &[Point2<f64>],
) -> usize {
    let seen = first_points.iter().filter(|point| **point != NOWHERE);
    let (low, high) = seen.fold(
        (
            Point2::new(f64::INFINITY, f64::INFINITY),
            Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY),
        ),
        |(low, high), point| (low.inf(point), high.sup(point)),
    );
    let is_inside =
        |at: Point2<f64>| at.x >= low.x && at.y >= low.y && at.x <= high.x && at.y <= high.y;
    pairs
        .iter()
        .filter(|pair| transform.map(pair.from).is_some_and(is_inside))
        .count()
}

/// Logarithm of a bound of the number of false alarms (Desolneux, Moisan and Morel 2000): that any of the distinct similarities
/// has so many inliers where each has `chance` of them in the mean, Poisson distributed (Chernoff's bound).
fn ln_false_alarms(inliers: usize, chance: f64) -> f64 {
    let inliers = inliers as f64;
    let tail = if inliers > chance {
        inliers - chance - inliers * (inliers / chance).ln()
    } else {
        0.0
    };
    DISTINCT_SIMILARITIES.ln() + tail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matches_beside_the_first_photo_cannot_agree() {
        let shift = nalgebra::Matrix3::new(1.0, 0.0, 60.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        let shift = Homography::from_matrix(shift).unwrap();
        let first = [Point2::new(-50.0, -40.0), Point2::new(50.0, 40.0), NOWHERE];
        // Shifted by 60 to the right, the first two are within the first photo and the third is beside it.
        let pairs = [-100.0, -20.0, 0.0]
            .map(|x| Correspondence::new(Point2::new(x, 10.0), Point2::origin()));
        assert_eq!(on_common_ground(&shift, &pairs, &first), 2);
    }

    #[test]
    fn inliers_count_against_what_chance_gives_along_the_transform() {
        // Of Poisson with mean 2: P(X >= 20) is 6.44e-14 (the series added up); the bound is above it, by a factor of ten.
        let exact = 6.44e-14f64.ln() + DISTINCT_SIMILARITIES.ln();
        let bound = ln_false_alarms(20, 2.0);
        assert!(
            bound > exact && bound < exact + 11f64.ln(),
            "{bound} {exact}"
        );
        // Few that agree are enough where chance gives none, and many are not where it gives as many.
        assert!(ln_false_alarms(16, 0.5) < MOST_FALSE_ALARMS.ln());
        assert!(ln_false_alarms(40, 35.0) > MOST_FALSE_ALARMS.ln());
        assert!(ln_false_alarms(3, 9.0) > 0.0);
    }
}
