//! Motion of the camera between two photos, from the keypoints that the localiser found in each.
//!
//! The keypoints are first seen from a camera that looks straight down: with attitude and focal length the ray of a keypoint
//! meets a level plane. Between two such views of level ground lies a similarity: the second camera's place in the first view,
//! the turn, and the ratio of the two heights. That ratio is not passed on: tilt that is not known changes it at every step in
//! the same direction, so chained over frames it drifts.

mod evidence;
mod levelling;
mod surface;

use nalgebra::Point2;

pub use levelling::FrameTilt;

use self::{
    evidence::{LEAST_INLIERS, is_motion},
    levelling::levelled_points,
    surface::Surface,
};
use crate::{
    error::Result,
    frame_features::FrameFeatures,
    geometry::{
        correspondence::Correspondence,
        covariance::{MIN_RESIDUAL_SIGMA_PX, mapped_point_covariance},
        distribution::spread,
        estimation::{EstimatedTransform, EstimationOptions, GeometryModel, estimate},
        ransac::{Ransac, Score},
        sampler::Sampling,
        similarity::Similarity,
        transform::Transform as _,
    },
    pipeline::{
        chance::expected_inliers,
        guided_matching::{KeypointPair, match_guided},
    },
    search::{matching::sort_best_first, scratch::Scratch},
};

/// What is known of the camera at two photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePair {
    /// Focal length of the full-size photo, pixels.
    pub focal_length_px: f64,
    /// Tilt at the first and at the second photo; `None` if unknown, which is treated as straight down.
    pub tilts: Option<[FrameTilt; 2]>,
    /// Error of the change of tilt between the photos, degrees per axis, 1 sigma. Where no tilt is known this is by how much it
    /// may change.
    pub tilt_change_sigma_deg: f64,
}

/// Motion of the camera between two photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameMotion {
    /// Displacement towards the top of the first photo, pixels that the full-size photo has straight below the camera.
    pub forward_px: f64,
    /// Displacement towards its right.
    pub right_px: f64,
    /// Turn of the photo's top from the first photo to the second, degrees clockwise, -180 to 180.
    pub turn_deg: f64,
    /// 1-sigma covariance of the displacement, square pixels: forward-forward, forward-right, right-right. It holds the scatter
    /// of the matches and the error of the tilt; relief and scale, which are relative to the distance, are not in it.
    pub covariance_px2: [f64; 3],
    /// Height at the second photo over height at the first. It is not to be chained.
    pub height_ratio: f64,
    /// Matches that agree.
    pub inliers: usize,
    /// By how much the surface that is seen may have moved itself, pixels per axis, 1 sigma: 0 over ground that the map shows,
    /// what the matches cannot tell apart from standing still where it moved with such ground. `None`: nothing shows that it is
    /// ground. Waves move by metres a second, and where they repeat the motion may be off by any number of wavelengths.
    pub surface_sigma_px: Option<f64>,
}

impl FrameMotion {
    /// Standard deviation of the displacement, pixels, along its less certain axis.
    pub fn sigma_px(&self) -> f64 {
        let [ff, fr, rr] = self.covariance_px2;
        (0.5 * (ff + rr) + (0.5 * (ff - rr)).hypot(fr)).sqrt()
    }
}

/// The matches that agree must have at least this standard deviation along their short axis, over half a photo's side.
const LEAST_SPREAD: f64 = 0.08;
/// Largest change of height between two photos, as a factor.
const MOST_HEIGHT_CHANGE: f64 = 1.35;
/// Weight of a match whose keypoints agreed with the map in both photos, in one, in none: roofs and trees seldom agree.
const WEIGHTS: [f64; 3] = [1.0, 0.6, 0.3];
/// RANSAC between two photos of one camera: twice as strict as between photo and map.
const RANSAC: Ransac = Ransac {
    threshold_px: 2.5,
    max_iterations: 1000,
    confidence: 0.999,
    score: Score::Truncated,
    local_optimisation: true,
    needs_support: true,
};

/// The motion of the camera from `first` to `second`; `None` if too few keypoints agree on one. Keypoints of `second` that moved
/// with the ground of `first` are marked.
pub(crate) fn motion_between(
    first: &FrameFeatures,
    second: &mut FrameFeatures,
    pair: &FramePair,
    seed: u64,
    scratch: &mut Scratch,
) -> Result<Option<FrameMotion>> {
    if first.len().min(second.len()) < LEAST_INLIERS || first.dim() != second.dim() {
        return Ok(None);
    }
    // All is done in pixels of the first query, where a keypoint is a whole pixel.
    let unit_px = first.photo_px_per_query_px;
    let [first_tilt, second_tilt] = pair.tilts.unwrap_or_default();
    let to = levelled_points(first, &first_tilt, pair.focal_length_px, unit_px);
    let from: Vec<Point2<f32>> =
        levelled_points(second, &second_tilt, pair.focal_length_px, unit_px)
            .iter()
            .map(|point| point.cast::<f32>())
            .collect();
    let keypoints = KeypointPair {
        points: &from,
        scores: &second.scores,
        tile_points: &to,
    };
    let Some((estimated, mut pairs)) = matched(first, second, &keypoints, seed, scratch)? else {
        return Ok(None);
    };
    let chance = expected_inliers(&estimated.homography, &keypoints, RANSAC.threshold_px);
    for (pair, found) in pairs.iter_mut().zip(&scratch.guided) {
        let on_map = [
            second.on_map[found.query as usize],
            first.on_map[found.tile as usize],
        ];
        pair.weight = WEIGHTS[on_map.iter().filter(|on_map| !**on_map).count()];
    }
    let agreeing: Vec<Correspondence> = estimated
        .inliers
        .iter()
        .map(|&index| pairs[index])
        .collect();
    let half_side = second.half_side_px() / unit_px;
    if !is_motion(agreeing.len(), chance, &estimated.homography, &pairs, &to)
        || spread(agreeing.iter().map(|pair| pair.from), half_side) < LEAST_SPREAD
    {
        return Ok(None);
    }
    let surface = Surface::of(
        &estimated.homography,
        first,
        &keypoints,
        RANSAC.threshold_px,
        scratch,
    );
    let motion = motion_of(&agreeing, pair, unit_px).map(|motion| FrameMotion {
        surface_sigma_px: surface.sigma(RANSAC.threshold_px * unit_px),
        ..motion
    });
    if motion.is_some() && surface != Surface::Unknown {
        let guided = estimated
            .inliers
            .iter()
            .filter_map(|&index| scratch.guided.get(index));
        for found in guided {
            second.followed[found.query as usize] = true;
        }
    }
    Ok(motion)
}

/// The similarity that levelled points of the second photo have to those of the first, with the pairs that it was fitted to;
/// those found by guided matching come first and are in `scratch.guided`.
fn matched(
    first: &FrameFeatures,
    second: &FrameFeatures,
    keypoints: &KeypointPair<'_>,
    seed: u64,
    scratch: &mut Scratch,
) -> Result<Option<(EstimatedTransform, Vec<Correspondence>)>> {
    let options = EstimationOptions {
        model: GeometryModel::Similarity,
        ransac: RANSAC,
        sampling: Sampling::Progressive,
        seed,
        refine: true,
        max_scale: MOST_HEIGHT_CHANGE,
        max_rotation_rad: f64::INFINITY,
        scale_prior: None,
    };
    let mut similarities =
        scratch
            .matcher
            .compare(second.descriptors(), first.descriptors(), first.dim())?;
    similarities.mutual(None, &mut scratch.matches);
    sort_best_first(&mut scratch.matches);
    let pairs = keypoints.pairs(&scratch.matches);
    let Some(start) = estimate(&pairs, &options) else {
        return Ok(None);
    };
    Ok(match_guided(
        &mut similarities,
        keypoints,
        &scratch.matches,
        &start,
        &options,
        &mut scratch.guided,
    ))
}

/// The motion that pairs of the second photo's levelled points and the first's give; `None` if they do not determine one.
fn motion_of(agreeing: &[Correspondence], pair: &FramePair, unit_px: f64) -> Option<FrameMotion> {
    let first_from_second = Similarity::fit(agreeing)?;
    // The second camera is straight above the origin of its own levelled view.
    let below = Point2::origin();
    let displacement = first_from_second.map(below)?.coords * unit_px;
    let of_matches =
        mapped_point_covariance(&first_from_second, agreeing, below, MIN_RESIDUAL_SIGMA_PX)?
            * unit_px.powi(2);
    let of_tilt = (pair.focal_length_px * pair.tilt_change_sigma_deg.to_radians()).powi(2);
    Some(FrameMotion {
        forward_px: -displacement.y,
        right_px: displacement.x,
        turn_deg: first_from_second.rotation_rad().to_degrees(),
        covariance_px2: [
            of_matches[(1, 1)] + of_tilt,
            -of_matches[(0, 1)],
            of_matches[(0, 0)] + of_tilt,
        ],
        height_ratio: first_from_second.scale(),
        inliers: agreeing.len(),
        surface_sigma_px: None,
    })
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Vector3;

    use super::{levelling::levelled, *};

    /// Where a camera sees a ground point: photo pixels from the centre, x right, y down. North, east and metres; written out
    /// from the axes and not with the rotation of [`levelled`].
    fn seen(
        ground_ne_m: [f64; 2],
        camera_ne_m: [f64; 2],
        height_m: f64,
        heading_deg: f64,
        tilt: &FrameTilt,
        focal_px: f64,
    ) -> Point2<f64> {
        let (sin_h, cos_h) = heading_deg.to_radians().sin_cos();
        let (sin_p, cos_p) = tilt.pitch_deg.to_radians().sin_cos();
        let (sin_r, cos_r) = tilt.roll_deg.to_radians().sin_cos();
        let ahead = Vector3::new(cos_h, sin_h, 0.0);
        let right_level = Vector3::new(-sin_h, cos_h, 0.0);
        let down = Vector3::z();
        let forward = ahead * cos_p - down * sin_p;
        let axis_pitched = ahead * sin_p + down * cos_p;
        let right = right_level * cos_r + axis_pitched * sin_r;
        let axis = axis_pitched * cos_r - right_level * sin_r;
        let ray = Vector3::new(
            ground_ne_m[0] - camera_ne_m[0],
            ground_ne_m[1] - camera_ne_m[1],
            height_m,
        );
        let depth = ray.dot(&axis);
        Point2::new(ray.dot(&right), -ray.dot(&forward)) * (focal_px / depth)
    }

    /// Pairs of a level ground seen by two cameras.
    fn pairs(tilts: [FrameTilt; 2], stated: [FrameTilt; 2]) -> Vec<Correspondence> {
        let ground = (0..64).map(|i| {
            let (row, column) = (i / 8, i % 8);
            [
                f64::from(row) * 14.0 - 30.0,
                f64::from(column) * 14.0 - 40.0,
            ]
        });
        ground
            .map(|at| {
                let first = seen(at, [0.0, 0.0], 100.0, 30.0, &tilts[0], 1000.0);
                let second = seen(at, [20.0, 15.0], 104.0, 75.0, &tilts[1], 1000.0);
                Correspondence::new(
                    levelled(second, &stated[1], 1000.0).unwrap(),
                    levelled(first, &stated[0], 1000.0).unwrap(),
                )
            })
            .collect()
    }

    const PAIR: FramePair = FramePair {
        focal_length_px: 1000.0,
        tilts: None,
        tilt_change_sigma_deg: 0.0,
    };

    #[test]
    fn a_stated_tilt_is_taken_out() {
        let tilts = [
            FrameTilt {
                pitch_deg: 12.0,
                roll_deg: -9.0,
            },
            FrameTilt {
                pitch_deg: -3.0,
                roll_deg: 25.0,
            },
        ];
        let motion = motion_of(&pairs(tilts, tilts), &PAIR, 1.0).unwrap();
        // 20 m north and 15 m east, seen from a heading of 30 degrees at 10 px a metre.
        let (sin, cos) = 30f64.to_radians().sin_cos();
        assert_relative_eq!(motion.forward_px, 200.0 * cos + 150.0 * sin, epsilon = 1e-3);
        assert_relative_eq!(motion.right_px, -200.0 * sin + 150.0 * cos, epsilon = 1e-3);
        assert_relative_eq!(motion.turn_deg, 45.0, epsilon = 1e-5);
        assert_relative_eq!(motion.height_ratio, 1.04, epsilon = 1e-5);
        let unlevelled = motion_of(&pairs(tilts, [FrameTilt::default(); 2]), &PAIR, 1.0).unwrap();
        let off_px = (unlevelled.forward_px - motion.forward_px)
            .hypot(unlevelled.right_px - motion.right_px);
        assert!(off_px > 100.0, "{off_px}");
    }

    #[test]
    fn the_error_of_the_tilt_is_in_the_covariance() {
        let level = [FrameTilt::default(); 2];
        let uncertain = FramePair {
            tilt_change_sigma_deg: 0.5,
            ..PAIR
        };
        let motion = motion_of(&pairs(level, level), &uncertain, 1.0).unwrap();
        // 0.5 degrees at a focal length of 1000 px are 8.7 px; the exact matches add less than a tenth of a pixel.
        assert_relative_eq!(motion.sigma_px(), 8.727, epsilon = 0.01);
        // A change of roll of half a degree that is not stated is an error of that size.
        let rolled = [
            FrameTilt::default(),
            FrameTilt {
                pitch_deg: 0.0,
                roll_deg: 0.5,
            },
        ];
        let off = motion_of(&pairs(rolled, level), &uncertain, 1.0).unwrap();
        let error_px = (off.forward_px - motion.forward_px).hypot(off.right_px - motion.right_px);
        assert!((7.0..11.0).contains(&error_px), "{error_px}");
    }
}
