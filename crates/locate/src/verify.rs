//! Full matching of one candidate: matches, transform, gates, and how far its centre may be off.

use grimnet_pack::Level;
use nalgebra::{Matrix2, Point2, Vector2};

use crate::{
    candidates::{Candidate, Desk},
    correspondence::Correspondence,
    covariance::{MIN_RESIDUAL_SIGMA_PX, mapped_point_covariance},
    error::Result,
    gates::Rejection,
    guided::{Sides, guide},
    homography::Homography,
    matching::Descriptors,
    options::Options,
    query_features::{PIXEL_CENTRE, QueryFeatures},
    solve::{Expected, solve},
    transform::Transform,
};

/// What full matching made of a candidate.
#[derive(Debug, Clone)]
pub(crate) struct Verified {
    /// The candidate.
    pub candidate: Candidate,
    /// Matched points: query pixels, and pixels of the tile at the query's resolution.
    pub pairs: Vec<Correspondence>,
    /// Indices of the pairs that agree.
    pub inliers: Vec<usize>,
    /// Query pixels to pixels of the tile at the query's resolution; none where no transform was found.
    pub transform: Option<Homography>,
    /// Covariance of the mapped centre, in the same pixels.
    pub covariance_px2: Option<Matrix2<f64>>,
    /// The photo's centre, continuous level pixels.
    pub centre_level_px: Option<[f64; 2]>,
    /// The first gate that it did not pass.
    pub rejection: Option<Rejection>,
}

/// The frame of a tile at the query's resolution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileFrame {
    /// Top-left corner, level pixels.
    pub origin_px: Vector2<f64>,
    /// Level pixels a pixel of the query: 1 but in packs built in paper mode.
    pub level_px_per_query_px: f64,
}

impl TileFrame {
    pub fn new(level: &Level, tile: usize) -> Self {
        let [x, y] = level.tile(tile).origin_px;
        Self {
            origin_px: Vector2::new(x as f64, y as f64),
            level_px_per_query_px: level_px_per_query_px(level),
        }
    }

    /// Continuous pixel of the tile at the query's resolution, of a keypoint's integer one at the level's.
    pub fn query_px(&self, keypoint_px: Point2<f32>) -> Point2<f64> {
        keypoint_px.map(|along| f64::from(along + PIXEL_CENTRE) / self.level_px_per_query_px)
    }

    /// Continuous level pixel of a pixel of the tile at the query's resolution.
    pub fn level_px(&self, in_tile: Point2<f64>) -> [f64; 2] {
        (self.origin_px + in_tile.coords * self.level_px_per_query_px).into()
    }
}

/// Level pixels a pixel that the network saw.
pub(crate) fn level_px_per_query_px(level: &Level) -> f64 {
    f64::from(level.tile_px()) / f64::from(level.manifest().network_px)
}

/// Matches `query` with the candidate's tile and checks the answer.
pub(crate) fn verify(
    level: &Level,
    query: &QueryFeatures,
    candidate: Candidate,
    expected: Expected,
    desk: &mut Desk,
    options: &Options,
) -> Result<Verified> {
    let frame = TileFrame::new(level, candidate.tile);
    let tile = level.features(candidate.tile);
    let tile_descriptors = Descriptors::I8 {
        values: &tile.descriptors,
        scale: tile.scale,
    };
    let tile_points: Vec<Point2<f64>> = tile
        .xy_px
        .iter()
        .map(|&[x, y]| frame.query_px(Point2::new(x, y)))
        .collect();
    let whole = query.strongest(usize::MAX);
    let mut compared = desk.matcher.compare(whole, tile_descriptors, query.dim)?;
    compared.mutual(options.max_ratio, &mut desk.matches);
    // Best first, as the progressive sampler wants them.
    desk.matches.sort_by(|a, b| {
        b.similarity
            .total_cmp(&a.similarity)
            .then(a.query.cmp(&b.query))
    });
    let sides = Sides {
        query,
        tile_points: &tile_points,
    };
    let mut pairs = sides.pairs(&desk.matches);
    let mut solved = solve(&pairs, expected, options);
    let start = solved.as_ref().filter(|_| options.guided);
    let again = start.and_then(|start| {
        let guided = &mut desk.guided;
        guide(
            &mut compared,
            &sides,
            &desk.matches,
            start,
            expected,
            options,
            guided,
        )
    });
    if let Some((by_guidance, near)) = again {
        (solved, pairs) = (Some(by_guidance), near);
    }
    let mut verified = Verified {
        candidate,
        pairs,
        inliers: Vec::new(),
        transform: None,
        covariance_px2: None,
        centre_level_px: None,
        rejection: None,
    };
    if let Some(solved) = solved {
        let agreeing: Vec<Correspondence> = solved
            .inliers
            .iter()
            .map(|&index| verified.pairs[index])
            .collect();
        verified.covariance_px2 = match &solved.similarity {
            Some(similarity) => {
                mapped_point_covariance(similarity, &agreeing, query.centre, MIN_RESIDUAL_SIGMA_PX)
            }
            None => mapped_point_covariance(
                &solved.homography,
                &agreeing,
                query.centre,
                MIN_RESIDUAL_SIGMA_PX,
            ),
        };
        verified.centre_level_px = solved
            .homography
            .map(query.centre)
            .map(|centre| frame.level_px(centre));
        verified.inliers = solved.inliers;
        verified.transform = Some(solved.homography);
    }
    verified.rejection = check(&verified, level, query, options).err();
    Ok(verified)
}

fn check(
    verified: &Verified,
    level: &Level,
    query: &QueryFeatures,
    options: &Options,
) -> std::result::Result<(), Rejection> {
    let needed = options.gates.map_or(0, |gates| gates.min_inliers);
    let Some(transform) = &verified.transform else {
        return Err(Rejection::Inliers { found: 0, needed });
    };
    let Some(gates) = &options.gates else {
        return Ok(());
    };
    let inliers = verified
        .inliers
        .iter()
        .map(|&index| verified.pairs[index].from);
    gates.check_support(inliers, verified.pairs.len(), query.half_side_px)?;
    gates.check_shape(transform, query.centre, 1.0)?;
    let [x, y] = verified.centre_level_px.ok_or(Rejection::NotFinite)?;
    let [width, height] = level.size_px();
    if !((0.0..=width as f64).contains(&x) && (0.0..=height as f64).contains(&y)) {
        return Err(Rejection::OutsideMap);
    }
    if verified.covariance_px2.is_none() {
        return Err(Rejection::NotFinite);
    }
    Ok(())
}
