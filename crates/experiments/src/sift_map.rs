//! The classical baseline: SIFT on the photo and on the map's tiles, with the geometry of default mode.
//!
//! Over all tiles it is the whole-map baseline; over the tiles that a search by descriptor found it is G + S of default mode.

use grimnet_geo::{GeoError, Georeference, LevelFrame, LevelPx, LonLat, Raster, RasterPatch};
use grimnet_kernels::Isa;
use grimnet_locate::internals::correspondence::Correspondence;
use grimnet_locate::internals::estimation::estimate;
use grimnet_locate::internals::matching::{Descriptors, Matcher, MatchingError};
use grimnet_locate::internals::transform::Transform;
use grimnet_locate::{GeometryModel, LocateError, Options, Prior};
use grimnet_pack::{Level, PackError, TILE_PX};
use grimnet_photo::{Photo, PhotoError, QueryOptions, QueryPx};
use image::imageops::grayscale;
use image::{GrayImage, Luma};
use nalgebra::Point2;
use rayon::prelude::*;

use crate::sift::{DESCRIPTOR_DIM, SiftFeatures, SiftOptions, sift};

/// Keypoints of a tile and of a photo at most.
const MOST_KEYPOINTS: usize = 2048;

/// Lowe's ratio (Lowe 2004, section 7.1; the paper's 3.5.2).
const RATIO: f32 = 0.8;

/// Pixels about the centre of an integer keypoint position: from pixel indices to continuous pixels.
const PIXEL_CENTRE: f64 = 0.5;

/// Keypoints nearer than this many of their sigmas to a masked area are removed: their descriptors would describe its border.
const BORDER_SIGMAS: f32 = 8.0;

/// Why the baseline cannot run.
#[derive(Debug, thiserror::Error)]
pub enum SiftMapError {
    /// The map.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// The photo.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// Matching.
    #[error(transparent)]
    Matching(#[from] MatchingError),
    /// The photo as the network sees it.
    #[error(transparent)]
    Locate(#[from] Box<LocateError>),
    /// The pack.
    #[error(transparent)]
    Pack(#[from] Box<PackError>),
}

/// SIFT features of every tile of one level.
pub struct SiftMap {
    frame: LevelFrame,
    georeference: Georeference,
    tiles: Vec<Tile>,
}

struct Tile {
    origin_px: [f64; 2],
    features: SiftFeatures,
}

/// Position found by SIFT.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftFix {
    /// The photo's centre.
    pub position: LonLat,
    /// Matches that agree with it.
    pub inliers: usize,
    /// The tile.
    pub tile: usize,
}

impl SiftMap {
    /// Features of every tile of `level`, from the map that it was built from.
    ///
    /// # Errors
    /// The map cannot be read.
    pub fn new(map: &dyn Raster, level: &Level) -> Result<Self, SiftMapError> {
        let tiles = (0..level.tile_count())
            .into_par_iter()
            .map(|i| {
                let patch = tile_patch(map, level, i)?;
                let features = seen(sift(&grayscale(&patch.rgb), &options()), &patch.valid);
                Ok(Tile {
                    origin_px: level.tile(i).origin_px.map(|v| v as f64),
                    features,
                })
            })
            .collect::<Result<_, GeoError>>()?;
        Ok(Self {
            frame: *level.frame(),
            georeference: level.georeference().clone(),
            tiles,
        })
    }

    /// Matches a photo with the tiles `among` (all tiles if `None`); the tile with the most inliers of a similarity is the answer.
    /// `None` if no tile has inliers.
    ///
    /// # Errors
    /// The photo cannot be resampled.
    pub fn locate(
        &self,
        photo: &Photo,
        prior: &Prior,
        among: Option<&[usize]>,
    ) -> Result<Option<SiftFix>, SiftMapError> {
        let view = photo.view(&prior.view);
        // Without a known scale the photo is made as wide as a tile: SIFT finds its own scale.
        let width_m = view.footprint.map_or_else(
            || f64::from(TILE_PX) * self.frame.gsd_m,
            |footprint| footprint.width_m,
        );
        let maker = photo.query_maker(&QueryOptions {
            tilt: view.tilt,
            ..QueryOptions::new(self.frame.gsd_m, width_m)
        })?;
        let up_deg = self
            .georeference
            .up_bearing_deg(self.georeference.centre_px())?;
        let query = maker.make(
            view.heading
                .map_or(0.0, |heading| heading.heading_deg - up_deg),
        );
        let features = seen(sift(&grayscale(&query.image), &options()), &query.mask);
        let centre = query.centre_px();
        let all: Vec<usize> = (0..self.tiles.len()).collect();
        let found: Vec<Option<(usize, [f64; 2], usize)>> = among
            .unwrap_or(&all)
            .par_iter()
            .map(|&tile| {
                let solved = self.match_tile(&features, tile, centre)?;
                Ok(solved.map(|(inliers, centre_px)| (inliers, centre_px, tile)))
            })
            .collect::<Result<_, SiftMapError>>()?;
        let best = found
            .into_iter()
            .flatten()
            .reduce(|a, b| if b.0 > a.0 { b } else { a });
        let Some((inliers, [x, y], tile)) = best else {
            return Ok(None);
        };
        // A wrong transform may lead outside of the coordinate system.
        let place = self
            .georeference
            .lonlat_from_map_px(self.frame.map_px_from_level_px(LevelPx::new(x, y)));
        Ok(place.ok().filter(LonLat::is_valid).map(|position| SiftFix {
            position,
            inliers,
            tile,
        }))
    }

    /// Inliers, and the photo's centre in level pixels.
    fn match_tile(
        &self,
        query: &SiftFeatures,
        tile: usize,
        centre: QueryPx,
    ) -> Result<Option<(usize, [f64; 2])>, SiftMapError> {
        let tile = &self.tiles[tile];
        let pairs = match_pairs(query, &tile.features)?;
        // SIFT knows its orientations: any rotation may come out.
        let options = Options {
            geometry: GeometryModel::Similarity,
            ..Options::default()
        };
        Ok(
            estimate(&pairs, &options.estimation(f64::INFINITY)).and_then(|solved| {
                let at = solved.homography.map(Point2::new(centre.x, centre.y))?;
                Some((
                    solved.inliers.len(),
                    [at.x + tile.origin_px[0], at.y + tile.origin_px[1]],
                ))
            }),
        )
    }
}

/// The pixels of a tile of `level`, from the map that it was built from.
pub(crate) fn tile_patch(
    map: &dyn Raster,
    level: &Level,
    tile: usize,
) -> Result<RasterPatch, GeoError> {
    let side_px = level.tile_px();
    let origin_px = level.tile(tile).origin_px.map(|v| v as f64);
    let size_px = f64::from(side_px);
    let window = level.frame().map_window(origin_px.into(), size_px, size_px);
    map.read(window, side_px, side_px)
}

/// The mutual nearest neighbours that pass Lowe's ratio test, best first, as points of both pictures.
pub(crate) fn match_pairs(
    query: &SiftFeatures,
    tile: &SiftFeatures,
) -> Result<Vec<Correspondence>, MatchingError> {
    let mut matches = Vec::new();
    Matcher::new(Isa::detect()).mutual(
        Descriptors::F32(&query.descriptors),
        Descriptors::F32(&tile.descriptors),
        DESCRIPTOR_DIM,
        Some(RATIO),
        &mut matches,
    )?;
    matches.sort_by(|a, b| {
        b.similarity
            .total_cmp(&a.similarity)
            .then(a.query.cmp(&b.query))
    });
    let point = |features: &SiftFeatures, i: u32| {
        let keypoint = &features.keypoints[i as usize];
        Point2::new(
            f64::from(keypoint.x_px) + PIXEL_CENTRE,
            f64::from(keypoint.y_px) + PIXEL_CENTRE,
        )
    };
    Ok(matches
        .iter()
        .map(|m| Correspondence::new(point(query, m.query), point(tile, m.tile)))
        .collect())
}

fn options() -> SiftOptions {
    SiftOptions {
        most: MOST_KEYPOINTS,
        ..SiftOptions::default()
    }
}

/// Keypoints whose surroundings are not masked.
pub(crate) fn seen(features: SiftFeatures, mask: &GrayImage) -> SiftFeatures {
    let is_seen = |x: f32, y: f32| {
        let (x, y) = (x.round() as i64, y.round() as i64);
        let outside =
            x < 0 || y < 0 || x >= i64::from(mask.width()) || y >= i64::from(mask.height());
        // Beyond the picture's own border nothing is drawn that could mislead.
        outside || *mask.get_pixel(x as u32, y as u32) != Luma([0])
    };
    let mut kept = SiftFeatures::default();
    let rows = features.descriptors.chunks_exact(DESCRIPTOR_DIM);
    for (keypoint, descriptor) in features.keypoints.iter().zip(rows) {
        let reach = BORDER_SIGMAS * keypoint.sigma_px;
        let around = (0..8).map(|i| (i as f32 * std::f32::consts::FRAC_PI_4).sin_cos());
        if around
            .into_iter()
            .all(|(sin, cos)| is_seen(keypoint.x_px + reach * cos, keypoint.y_px + reach * sin))
        {
            kept.keypoints.push(*keypoint);
            kept.descriptors.extend_from_slice(descriptor);
        }
    }
    kept
}
