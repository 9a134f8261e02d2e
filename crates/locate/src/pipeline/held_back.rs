//! Evidence that was held back: how well the photo agrees with the map where the search found nothing.
//!
//! Inliers were selected by the transform that they support. The map's other keypoints were not: at the right position the photo
//! resembles them where the transform maps them, at a wrong one no more than around there. This separates right answers with few
//! inliers from wrong ones, independently of the number of inliers.

use grimnet_net::Keypoint;
use grimnet_pack::{Level, LocalDescriptors, TileFeatures};
use nalgebra::{Point2, Vector2};

use crate::{
    dense_query::DenseQuery,
    error::Result,
    geometry::{homography::Homography, transform::Transform as _},
    pipeline::{tile_frame::TileFrame, verification::VerifiedCandidate},
    query_features::PIXEL_CENTRE,
};

/// Keypoints of the map that are closer to an inlier share most of what their descriptors see with it, tile pixels.
const APART_PX: f64 = 10.0;

/// Distances from the mapped position at which the photo is compared as well, query pixels: two and a half and four cells of the
/// descriptor field, in eight directions each.
const SURROUNDINGS_PX: [f32; 2] = [20.0, 32.0];
const DIRECTIONS: usize = 8;

/// Agreement of the photo with the map's keypoints that are not inliers.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct HeldBack {
    /// Number of keypoints of the map, apart from the inliers, that the photo shows.
    pub points: usize,
    /// Mean excess of the cosine similarity between their descriptors and the photo's at the mapped positions over that around
    /// these positions, -2 to 2; 0 without points.
    pub excess: f64,
}

impl HeldBack {
    /// Compares the query with the keypoints of the candidate's tile.
    pub fn of(query: &DenseQuery, level: &Level, verified: &VerifiedCandidate) -> Result<Self> {
        let Some(to_query) = verified.transform.as_ref().and_then(Homography::inverse) else {
            return Ok(Self::default());
        };
        let tile = verified.candidate.tile;
        let frame = TileFrame::new(level, tile);
        let inliers: Vec<Point2<f64>> = verified
            .inliers
            .iter()
            .map(|&index| verified.pairs[index].to)
            .collect();
        let features = level.features(tile)?;
        let shifts = shifts();
        let shown = shown(query, &features, &frame, &to_query, &inliers, &shifts);
        Ok(Self::along(query, &features, &shown, &shifts))
    }

    /// For keypoints of the tile and the positions in the query that they are mapped to.
    fn along(
        query: &DenseQuery,
        features: &TileFeatures,
        shown: &[(usize, Point2<f64>)],
        shifts: &[Vector2<f32>],
    ) -> Self {
        let at: Vec<Keypoint> = shown
            .iter()
            .flat_map(|&(_, point)| {
                shifts.iter().map(move |shift| Keypoint {
                    x_px: point.x as f32 - PIXEL_CENTRE + shift.x,
                    y_px: point.y as f32 - PIXEL_CENTRE + shift.y,
                    score: 1.0,
                })
            })
            .collect();
        let described = query.dense.describe(&at);
        let dim = query.dense.descriptors().channels();
        let mut descriptor = vec![0.0; dim];
        let excess_of = |(&(keypoint, _), rows): (&(usize, Point2<f64>), &[f32])| {
            copy_descriptor(&features.descriptors, keypoint, &mut descriptor);
            let mut similarities = rows.chunks_exact(dim).map(|row| dot(&descriptor, row));
            let here = similarities.next().unwrap_or_default();
            here - similarities.sum::<f64>() / (shifts.len() - 1) as f64
        };
        let total: f64 = shown
            .iter()
            .zip(described.chunks_exact(shifts.len() * dim))
            .map(excess_of)
            .sum();
        Self {
            points: shown.len(),
            excess: total / shown.len().max(1) as f64,
        }
    }
}

/// Shifts of the positions that are compared, the mapped position first.
fn shifts() -> Vec<Vector2<f32>> {
    let turn = std::f32::consts::TAU / DIRECTIONS as f32;
    let around = SURROUNDINGS_PX
        .iter()
        .enumerate()
        .flat_map(|(ring, &radius_px)| {
            // The directions of one ring lie between those of the other.
            (0..DIRECTIONS).map(move |step| {
                let angle = turn * (step as f32 + ring as f32 / 2.0);
                Vector2::new(radius_px * angle.cos(), radius_px * angle.sin())
            })
        });
    std::iter::once(Vector2::zeros()).chain(around).collect()
}

/// The tile's keypoints apart from the inliers that the query shows with their surroundings, and their positions in the query.
fn shown(
    query: &DenseQuery,
    features: &TileFeatures,
    frame: &TileFrame,
    to_query: &Homography,
    inliers: &[Point2<f64>],
    shifts: &[Vector2<f32>],
) -> Vec<(usize, Point2<f64>)> {
    let keypoints = features.xy_px.iter().enumerate();
    keypoints
        .filter_map(|(index, &[x, y])| {
            let at: Point2<f64> = frame.tile_px_from_keypoint(Point2::new(x, y)).into();
            let near = |inlier: &Point2<f64>| nalgebra::distance(inlier, &at) < APART_PX;
            let point = to_query.map(at).filter(|_| !inliers.iter().any(near))?;
            let is_shown = |shift: &Vector2<f32>| query.shows(point + shift.cast());
            shifts.iter().all(is_shown).then_some((index, point))
        })
        .collect()
}

fn copy_descriptor(from: &LocalDescriptors, keypoint: usize, to: &mut [f32]) {
    let range = keypoint * to.len()..(keypoint + 1) * to.len();
    match from {
        LocalDescriptors::Int8 { values, scale } => {
            for (to, &value) in to.iter_mut().zip(&values[range]) {
                *to = f32::from(value) * scale;
            }
        }
        LocalDescriptors::Float32(values) => to.copy_from_slice(&values[range]),
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    f64::from(a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>())
}

#[cfg(test)]
mod tests {
    use grimnet_geo::LevelPx;
    use grimnet_net::{Domain, ExtractOptions, Extractor, Model};
    use image::{GrayImage, Luma, Rgb, RgbImage};
    use nalgebra::Matrix3;

    use super::*;

    const SIDE_PX: u32 = 256;

    /// Blocks of random grey, so that every place looks different.
    fn picture() -> RgbImage {
        let value = |x: u32, y: u32| {
            let cell = u64::from(x / 12) * 7919 + u64::from(y / 9) * 104_729 + 17;
            (cell.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u8
        };
        RgbImage::from_fn(SIDE_PX, SIDE_PX, |x, y| Rgb([value(x, y); 3]))
    }

    fn held_back(shift_px: f64, inliers: &[Point2<f64>]) -> HeldBack {
        let model = Model::bundled().unwrap();
        let extractor = Extractor::new(&model, Domain::Uav).unwrap();
        let picture = picture();
        let options = ExtractOptions {
            threshold: 0.005,
            max_keypoints: 400,
            nms_radius_px: 4,
        };
        let map = extractor.extract(&picture, None, &options).unwrap();
        let features = TileFeatures {
            xy_px: map.keypoints.iter().map(|k| [k.x_px, k.y_px]).collect(),
            scores: map.keypoints.iter().map(|k| k.score).collect(),
            descriptors: LocalDescriptors::Float32(map.descriptors),
            descriptor_dim: map.descriptor_dim,
        };
        let query = DenseQuery {
            dense: extractor.dense(&picture, None).unwrap(),
            mask: GrayImage::from_pixel(SIDE_PX, SIDE_PX, Luma([255])),
        };
        let frame = TileFrame {
            origin: LevelPx::new(0.0, 0.0),
            level_px_per_query_px: 1.0,
        };
        let shift = Matrix3::new(1.0, 0.0, shift_px, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        let to_query = Homography::from_matrix(shift).unwrap();
        let shifts = shifts();
        let shown = shown(&query, &features, &frame, &to_query, inliers, &shifts);
        HeldBack::along(&query, &features, &shown, &shifts)
    }

    #[test]
    fn the_right_position_agrees_and_a_wrong_one_does_not() {
        let right = held_back(0.0, &[]);
        assert!(right.points > 30, "{right:?}");
        assert!(right.excess > 0.4, "{right:?}");
        let wrong = held_back(37.0, &[]);
        assert!(wrong.excess < 0.3 * right.excess, "{wrong:?}, {right:?}");
    }

    #[test]
    fn what_lies_beside_an_inlier_is_not_counted() {
        let all = held_back(0.0, &[]);
        let everywhere: Vec<_> = (0..SIDE_PX)
            .flat_map(|x| (0..SIDE_PX).map(move |y| Point2::new(f64::from(x), f64::from(y))))
            .collect();
        assert_eq!(held_back(0.0, &everywhere), HeldBack::default());
        let half: Vec<_> = everywhere.into_iter().filter(|p| p.x < 128.0).collect();
        let rest = held_back(0.0, &half);
        assert!(0 < rest.points && rest.points < all.points, "{rest:?}");
    }

    #[test]
    fn surroundings_lie_in_sixteen_different_directions() {
        let shifts = shifts();
        assert_eq!(shifts.len(), 17);
        assert_eq!(shifts[0], Vector2::zeros());
        for (i, a) in shifts.iter().enumerate() {
            for b in &shifts[..i] {
                assert!((a - b).norm() > 10.0, "{a} {b}");
            }
        }
    }
}
