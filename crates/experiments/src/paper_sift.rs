//! The paper's G + S: its procedure with SIFT in place of the learned keypoints and descriptors, and everything else as it is, but for
//! coordinates, which come from the map's georeference.
//!
//! Photo and tiles are the squares that the network sees; the homography is the paper's RANSAC-DLT with its refinement, the tile of the
//! largest inliers / (matches + 1) wins (eq. 20), and the photo's centre through it is the answer.

use grimnet_geo::{LevelPx, LonLat, Raster};
use grimnet_locate::internals::estimation::estimate;
use grimnet_locate::internals::transform::Transform;
use grimnet_locate::{Localizer, Options, Prior};
use grimnet_pack::{Level, resize_for_network};
use grimnet_photo::Photo;
use image::imageops::{FilterType, grayscale, resize};
use nalgebra::Point2;
use rayon::prelude::*;

use crate::sift::{SiftFeatures, SiftOptions, sift};
use crate::sift_map::{SiftFix, SiftMapError, match_pairs, seen, tile_patch};

/// SIFT features of the tiles of a pack of paper mode, in pixels of the network's picture.
pub struct PaperSift {
    tiles: Vec<SiftFeatures>,
}

/// What matching with one tile gave.
struct Verified {
    tile: usize,
    inliers: usize,
    /// Inliers / (matches + 1).
    ratio: f64,
    /// The photo's centre, pixels of the level.
    centre_px: Option<LevelPx>,
}

impl PaperSift {
    /// Features of every tile of `level`, from the map that it was built from.
    ///
    /// # Errors
    /// The map cannot be read.
    pub fn new(map: &dyn Raster, level: &Level) -> Result<Self, SiftMapError> {
        let side_px = level.manifest().network_px;
        let tiles = (0..level.tile_count())
            .into_par_iter()
            .map(|i| {
                let patch = tile_patch(map, level, i)?;
                let picture = resize_for_network(&patch.rgb, side_px);
                let valid = resize(&patch.valid, side_px, side_px, FilterType::Nearest);
                Ok(seen(sift(&grayscale(&picture), &options()), &valid))
            })
            .collect::<Result<_, SiftMapError>>()?;
        Ok(Self { tiles })
    }

    /// Matches a photo with the tiles `among`, the most similar one first; `None` if there are none. Where no tile has a homography the
    /// centre of the first is the answer, and where the winning one leads off the Earth that of its tile.
    ///
    /// # Errors
    /// The photo cannot be resampled, or the pack has a tile off the Earth.
    pub fn locate(
        &self,
        localizer: &Localizer,
        level: &Level,
        (photo, prior): (&Photo, &Prior),
        among: &[usize],
    ) -> Result<Option<SiftFix>, SiftMapError> {
        let image = localizer.network_image(photo, prior).map_err(Box::new)?;
        let features = sift(&grayscale(&image.rgb), &options());
        let features = match &image.mask {
            Some(mask) => seen(features, mask),
            None => features,
        };
        // The network's picture is scaled and turned about the photo's centre.
        let middle_px = f64::from(level.manifest().network_px) / 2.0;
        let centre_px = Point2::new(middle_px, middle_px);
        let verified: Vec<Verified> = among
            .par_iter()
            .map(|&tile| self.verify(level, &features, centre_px, tile))
            .collect::<Result<_, SiftMapError>>()?;
        let best = verified
            .into_iter()
            .reduce(|a, b| if b.ratio > a.ratio { b } else { a });
        let Some(best) = best else {
            return Ok(None);
        };
        let mapped = best
            .centre_px
            .and_then(|centre_px| level.lonlat_from_level_px(centre_px).ok())
            .filter(LonLat::is_valid);
        let position = match mapped {
            Some(position) => position,
            None => level
                .lonlat_from_level_px(level.tile(best.tile).centre_px)
                .map_err(Box::new)?,
        };
        Ok(Some(SiftFix {
            position,
            inliers: best.inliers,
            tile: best.tile,
        }))
    }

    fn verify(
        &self,
        level: &Level,
        query: &SiftFeatures,
        centre_px: Point2<f64>,
        tile: usize,
    ) -> Result<Verified, SiftMapError> {
        let pairs = match_pairs(query, &self.tiles[tile])?;
        let solved = estimate(&pairs, &Options::paper().estimation(f64::INFINITY));
        let inliers = solved.as_ref().map_or(0, |solved| solved.inliers.len());
        let level_px_per_network_px =
            f64::from(level.tile_px()) / f64::from(level.manifest().network_px);
        let origin_px = level.tile(tile).origin_px.map(|v| v as f64);
        let mapped = solved.and_then(|solved| solved.homography.map(centre_px));
        Ok(Verified {
            tile,
            inliers,
            ratio: inliers as f64 / (pairs.len() as f64 + 1.0),
            centre_px: mapped.map(|at| LevelPx {
                x: origin_px[0] + at.x * level_px_per_network_px,
                y: origin_px[1] + at.y * level_px_per_network_px,
            }),
        })
    }
}

/// As many keypoints as the paper's matching head may give.
fn options() -> SiftOptions {
    SiftOptions {
        most: Options::paper().max_keypoints,
        ..SiftOptions::default()
    }
}
