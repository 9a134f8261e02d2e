//! From the transform between query and tile to position, heading, ground resolution and covariance.

use grimnet_geo::{LevelPx, LonLat, WindowPx};
use grimnet_net::PositionError;
use grimnet_pack::Level;
use grimnet_photo::{Photo, PhotoPx};
use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use crate::{
    error::Result,
    geometry::{
        covariance::{propagate, radius95},
        homography::Homography,
        transform::Transform,
    },
    options::Options,
    outcome::{MatchedPair, MatchedPoints},
    pipeline::{tile_frame::TileFrame, verification::VerifiedCandidate},
    query_features::QueryFeatures,
};

/// The ground position of a verified candidate.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GroundPosition {
    pub centre: LonLat,
    pub heading_deg: f64,
    pub gsd_m: f64,
    pub inlier_covariance_en_m2: [f64; 3],
    pub covariance_en_m2: [f64; 3],
    pub radius95_m: f64,
    /// Share of the photo that lies on the map, 0 to 1.
    pub on_map: f64,
    pub outline_lon_lat_deg: Vec<[f64; 2]>,
}

/// Level pixels from pixels of `Photo::image` relative to its centre, both continuous.
///
/// A [`Homography`] maps its origin. That is the centre and not a corner, because of a strongly tilted photo the corners may be above
/// the horizon.
fn level_from_centred_photo(
    transform: &Homography,
    frame: &TileFrame,
    photo_px_from_query_px: &Matrix3<f64>,
    photo: &Photo,
) -> Option<Homography> {
    let s = frame.level_px_per_query_px;
    let level_from_tile = Matrix3::new(
        s,
        0.0,
        frame.origin.x,
        0.0,
        s,
        frame.origin.y,
        0.0,
        0.0,
        1.0,
    );
    let query_from_photo = photo_px_from_query_px.try_inverse()?;
    let [x, y] = half_size_px(photo);
    let photo_from_centred = Matrix3::new(1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0, 1.0);
    transform.with_matrix(
        level_from_tile * transform.as_matrix() * query_from_photo * photo_from_centred,
    )
}

/// Half of width and height of `Photo::image`, pixels: its centre.
fn half_size_px(photo: &Photo) -> [f64; 2] {
    let (width, height) = photo.image.dimensions();
    [f64::from(width) / 2.0, f64::from(height) / 2.0]
}

/// Derivative of metres east and north by level pixels, at a point of the level.
pub(crate) fn en_m_from_level_px_jacobian(
    level: &Level,
    level_px: LevelPx,
) -> Result<Matrix2<f64>> {
    let frame = level.frame();
    let by_map_px = level
        .georeference()
        .east_north_m_from_map_px_jacobian(level.map_px_from_level_px(level_px))?;
    Ok(by_map_px
        * Matrix2::new(
            frame.map_px_per_level_px_x,
            0.0,
            0.0,
            frame.map_px_per_level_px_y,
        ))
}

/// The ground position of a verified candidate; `None` if it has no finite one.
pub(crate) fn ground_position(
    verified: &VerifiedCandidate,
    level: &Level,
    query: &QueryFeatures,
    photo: &Photo,
    error: &PositionError,
    options: &Options,
) -> Result<Option<GroundPosition>> {
    let frame = TileFrame::new(level, verified.candidate.tile);
    let (Some(transform), Some(centre_px), Some(covariance_px2)) = (
        &verified.transform,
        verified.centre_level_px,
        verified.covariance_px2,
    ) else {
        return Ok(None);
    };
    let to_photo = &query.photo_px_from_query_px;
    let Some(level_from_photo) = level_from_centred_photo(transform, &frame, to_photo, photo)
    else {
        return Ok(None);
    };
    let Some(level_px_by_photo_px) = level_from_photo.point_jacobian(Point2::origin()) else {
        return Ok(None);
    };
    let en_by_level_px = en_m_from_level_px_jacobian(level, centre_px)?;
    let en_by_photo_px = en_by_level_px * level_px_by_photo_px;
    let up: Vector2<f64> = en_by_photo_px * Vector2::new(0.0, -1.0);
    // `Photo::image` may be a reduced copy.
    let photo_px_per_full_px =
        f64::from(photo.image.width()) / f64::from(photo.full_size_px.0.max(1));

    let s = frame.level_px_per_query_px;
    let of_inliers = propagate(&(covariance_px2 * (s * s)), &en_by_level_px);
    let shared = propagate(
        &(Matrix2::identity() * error.shared_px.powi(2)),
        &en_by_level_px,
    );
    let map_m2 = Matrix2::identity() * options.map_error_m.powi(2);
    let covariance = of_inliers * error.inlier_factor + shared + map_m2;

    let outline_lon_lat_deg = centred_corners_px(photo)
        .into_iter()
        .filter_map(|corner| level_from_photo.map(corner))
        .filter_map(|corner| {
            let corner = LevelPx::new(corner.x, corner.y);
            level.lonlat_from_level_px(corner).ok()
        })
        .map(|corner| [corner.lon_deg, corner.lat_deg])
        .collect();
    Ok(Some(GroundPosition {
        on_map: share_on_map(&level_from_photo, photo, level),
        centre: level.lonlat_from_level_px(centre_px)?,
        heading_deg: up.x.atan2(up.y).to_degrees().rem_euclid(360.0),
        gsd_m: en_by_photo_px.determinant().abs().sqrt() * photo_px_per_full_px,
        inlier_covariance_en_m2: upper(&of_inliers),
        covariance_en_m2: upper(&covariance),
        radius95_m: radius95(&covariance),
        outline_lon_lat_deg,
    }))
}

/// Number of sample points along each side of the photo.
const SAMPLES: u32 = 16;

/// Share of the photo that lies on the level, by a grid of points. The transform is from pixels relative to the photo's centre.
fn share_on_map(level_from_photo: &Homography, photo: &Photo, level: &Level) -> f64 {
    let [half_width, half_height] = half_size_px(photo);
    let along =
        |index: u32, half: f64| (2.0 * (f64::from(index) + 0.5) / f64::from(SAMPLES) - 1.0) * half;
    let [level_width, level_height] = level.size_px().map(|side| side as f64);
    let on_level = (0..SAMPLES * SAMPLES)
        .filter_map(|i| {
            level_from_photo.map(Point2::new(
                along(i % SAMPLES, half_width),
                along(i / SAMPLES, half_height),
            ))
        })
        .filter(|at| (0.0..=level_width).contains(&at.x) && (0.0..=level_height).contains(&at.y))
        .count();
    on_level as f64 / f64::from(SAMPLES * SAMPLES)
}

fn upper(symmetric: &Matrix2<f64>) -> [f64; 3] {
    [symmetric[(0, 0)], symmetric[(0, 1)], symmetric[(1, 1)]]
}

/// The matched points in pixels of the photo and of the map.
pub(crate) fn matched_points(
    verified: &VerifiedCandidate,
    level: &Level,
    query: &QueryFeatures,
    photo: &Photo,
) -> MatchedPoints {
    let frame = TileFrame::new(level, verified.candidate.tile);
    let photo_px = |point: Point2<f64>| {
        Point2::from_homogeneous(query.photo_px_from_query_px * point.to_homogeneous())
    };
    let pairs = verified
        .pairs
        .iter()
        .enumerate()
        .filter_map(|(index, pair)| {
            let level_px = frame.level_px_from_tile_px(pair.to.into());
            Some(MatchedPair {
                photo_px: PhotoPx::from(photo_px(pair.from)?),
                map_px: level.map_px_from_level_px(level_px),
                is_inlier: verified.inliers.binary_search(&index).is_ok(),
            })
        });
    let side_px = f64::from(level.tile_px());
    let top_left = level.map_px_from_level_px(frame.origin);
    let bottom_right = level.map_px_from_level_px(frame.origin.offset(side_px, side_px));
    let to_photo = &query.photo_px_from_query_px;
    let to_level = verified
        .transform
        .as_ref()
        .and_then(|transform| level_from_centred_photo(transform, &frame, to_photo, photo));
    let outline_map_px = to_level.map_or(Vec::new(), |to_level| {
        centred_corners_px(photo)
            .into_iter()
            .filter_map(|corner| to_level.map(corner))
            .map(|corner| level.map_px_from_level_px(LevelPx::new(corner.x, corner.y)))
            .collect()
    });
    MatchedPoints {
        pairs: pairs.collect(),
        tile_map_px: WindowPx::new(
            top_left.x,
            top_left.y,
            bottom_right.x - top_left.x,
            bottom_right.y - top_left.y,
        ),
        outline_map_px,
    }
}

/// Corners of `Photo::image` relative to its centre: top left, top right, bottom right, bottom left.
fn centred_corners_px(photo: &Photo) -> [Point2<f64>; 4] {
    let [x, y] = half_size_px(photo);
    [(-x, -y), (x, -y), (x, y), (-x, y)].map(|(x, y)| Point2::new(x, y))
}

#[cfg(test)]
mod tests {
    use grimnet_photo::{Metadata, QueryOptions, Tilt};
    use image::RgbImage;

    use super::*;

    /// The centre and the near corners are mapped whether the far corners are below the horizon (60 degrees from nadir) or above it.
    #[test]
    fn a_photo_with_the_sky_in_its_far_corners_has_a_position() {
        let photo = Photo::from_image(RgbImage::new(400, 300), Metadata::default());
        let frame = TileFrame {
            origin: LevelPx::new(1000.0, 2000.0),
            level_px_per_query_px: 1.0,
        };
        let transform = Homography::from_matrix(Matrix3::identity()).unwrap();
        for (pitch_from_nadir_deg, corners) in [(0.0, 4), (60.0, 4), (65.0, 2), (75.0, 2)] {
            let tilt = Tilt {
                pitch_from_nadir_deg,
                roll_deg: 0.0,
                hfov_deg: 71.6,
            };
            let options = QueryOptions {
                tilt: Some(tilt),
                ..QueryOptions::new(0.5, 200.0)
            };
            let query = photo.query_maker(&options).unwrap().make(30.0);
            let to_photo = &query.photo_px_from_query_px;
            let to_level = level_from_centred_photo(&transform, &frame, to_photo, &photo).unwrap();
            let centre = to_level.map(Point2::origin()).unwrap();
            let expected = query.centre_px();
            assert!((centre.x - 1000.0 - expected.x).abs() < 1e-6);
            assert!((centre.y - 2000.0 - expected.y).abs() < 1e-6);
            // At the centre the picture's width is 400 query pixels of half a metre.
            let jacobian = to_level.point_jacobian(Point2::origin()).unwrap();
            assert!((jacobian.column(0).norm() - 1.0).abs() < 1e-6);
            let on_ground = centred_corners_px(&photo)
                .into_iter()
                .filter_map(|corner| to_level.map(corner));
            assert_eq!(on_ground.count(), corners, "{pitch_from_nadir_deg}");
        }
    }
}
