//! Full matching of one candidate: matches, transform, gates, and the covariance of the mapped centre.

use grimnet_geo::LevelPx;
use grimnet_pack::Level;
use grimnet_photo::QueryPx;
use nalgebra::{Matrix2, Point2};

use crate::{
    context::Context,
    error::Result,
    geometry::{
        correspondence::Correspondence,
        covariance::{MIN_RESIDUAL_SIGMA_PX, mapped_point_covariance},
        estimation::{EstimatedTransform, EstimationOptions, estimate},
        homography::Homography,
        scale_prior::ScalePrior,
        transform::Transform,
    },
    options::Options,
    outcome::Rejection,
    pipeline::{
        chance::expected_inliers,
        gates::Shape,
        guided_matching::{KeypointPair, match_guided},
        tile_frame::TileFrame,
    },
    prior::Near,
    query_features::QueryFeatures,
    search::{
        candidates::Candidate,
        hypotheses::Hypothesis,
        matching::{Descriptors, sort_best_first},
        scratch::Scratch,
    },
};

/// A candidate with the result of its full matching.
#[derive(Debug, Clone)]
pub(crate) struct VerifiedCandidate {
    /// The candidate.
    pub candidate: Candidate,
    /// Matched points: query pixels, and pixels of the tile at the query's resolution.
    pub pairs: Vec<Correspondence>,
    /// Indices of the pairs that agree with the transform, ascending.
    pub inliers: Vec<usize>,
    /// Query pixels to pixels of the tile at the query's resolution; `None` if no transform was found.
    pub transform: Option<Homography>,
    /// Covariance of the mapped centre, in the same pixels.
    pub covariance_px2: Option<Matrix2<f64>>,
    /// Expected number of inliers if descriptors said nothing.
    pub expected_inliers: f64,
    /// What an inlier counts as by how probable the transform's scale is, see [`ScalePrior::inlier_weight`].
    pub inlier_weight: f64,
    /// The photo's centre.
    pub centre_level_px: Option<LevelPx>,
    /// The first gate that the candidate does not pass.
    pub rejection: Option<Rejection>,
}

impl VerifiedCandidate {
    /// Number of inliers, less for a transform of an improbable scale.
    pub fn weighted_inliers(&self) -> f64 {
        self.inlier_weight * self.inliers.len() as f64
    }

    /// The candidate, rejected if the photo's centre is outside of the area: tiles that show a part of it reach beyond.
    fn within(self, near: Option<&Near>, level: &Level) -> Self {
        let (Some(near), Some(centre), None) = (near, self.centre_level_px, self.rejection) else {
            return self;
        };
        // A point without coordinates is in no area.
        let is_inside = level
            .lonlat_from_level_px(centre)
            .is_ok_and(|centre| near.contains(centre));
        Self {
            rejection: (!is_inside).then_some(Rejection::OutsideArea),
            ..self
        }
    }
}

/// What is known of a transform before any point is matched.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Expected {
    /// Largest rotation in either direction, radians.
    pub max_rotation_rad: f64,
    /// How probable its scales are; `None` if all are alike.
    pub scale_prior: Option<ScalePrior>,
}

impl Expected {
    /// Nothing is known.
    pub const NOTHING: Self = Self {
        max_rotation_rad: f64::INFINITY,
        scale_prior: None,
    };
}

/// Matches the candidate's query with its tile, with rotation and scale as its hypothesis expects them, and checks whether it is in the
/// given area.
pub(crate) fn verify(
    context: Context<'_>,
    level: &Level,
    hypotheses: &[Hypothesis],
    queries: &[QueryFeatures],
    candidate: Candidate,
    near: Option<&Near>,
) -> Result<VerifiedCandidate> {
    let hypothesis = &hypotheses[candidate.query];
    let expected = Expected {
        max_rotation_rad: hypothesis.heading_reach_deg.to_radians(),
        scale_prior: hypothesis.scale_prior(),
    };
    let query = &queries[candidate.query];
    let verified = context
        .scratch
        .with(|scratch| verify_with(level, query, candidate, expected, scratch, context.options))?;
    Ok(verified.within(near, level))
}

/// Matches `query` with the candidate's tile.
pub(crate) fn verify_with(
    level: &Level,
    query: &QueryFeatures,
    candidate: Candidate,
    expected: Expected,
    scratch: &mut Scratch,
    options: &Options,
) -> Result<VerifiedCandidate> {
    let frame = TileFrame::new(level, candidate.tile);
    let MatchedTile {
        estimated,
        pairs,
        expected_inliers,
    } = match_tile(
        level,
        query,
        &frame,
        candidate.tile,
        expected,
        scratch,
        options,
    )?;
    let mut verified = VerifiedCandidate {
        candidate,
        pairs,
        inliers: Vec::new(),
        transform: None,
        covariance_px2: None,
        expected_inliers,
        inlier_weight: 1.0,
        centre_level_px: None,
        rejection: None,
    };
    if let Some(estimated) = estimated {
        verified.covariance_px2 = centre_covariance(&estimated, &verified.pairs, query.centre_px);
        verified.centre_level_px = estimated
            .homography
            .map(query.centre_px.into())
            .map(|centre| frame.level_px_from_tile_px(centre.into()));
        let scale =
            Shape::at(&estimated.homography, query.centre_px.into()).map(|shape| shape.scale);
        if let (Some(prior), Ok(scale)) = (expected.scale_prior, scale) {
            verified.inlier_weight = prior.inlier_weight(scale);
        }
        verified.inliers = estimated.inliers;
        verified.transform = Some(estimated.homography);
    }
    verified.rejection = check_gates(&verified, level, query, options).err();
    Ok(verified)
}

/// A query matched with a tile.
struct MatchedTile {
    /// The transform; `None` if none was found.
    estimated: Option<EstimatedTransform>,
    /// The matches.
    pairs: Vec<Correspondence>,
    /// Expected number of inliers if descriptors said nothing.
    expected_inliers: f64,
}

/// Matches and estimates the transform, by mutual nearest neighbours first and then guided by the transform that they give.
fn match_tile(
    level: &Level,
    query: &QueryFeatures,
    frame: &TileFrame,
    tile: usize,
    expected: Expected,
    scratch: &mut Scratch,
    options: &Options,
) -> Result<MatchedTile> {
    let estimation = EstimationOptions {
        scale_prior: expected.scale_prior,
        ..options.estimation(expected.max_rotation_rad)
    };
    let tile = level.features(tile)?;
    let tile_descriptors = Descriptors::from(&tile.descriptors);
    let tile_points: Vec<Point2<f64>> = tile
        .xy_px
        .iter()
        .map(|&[x, y]| frame.tile_px_from_keypoint(Point2::new(x, y)).into())
        .collect();
    let whole = query.strongest(usize::MAX);
    let mut similarities = scratch
        .matcher
        .compare(whole, tile_descriptors, query.dim)?;
    similarities.mutual(options.max_ratio, &mut scratch.matches);
    sort_best_first(&mut scratch.matches);
    let keypoints = KeypointPair {
        points: &query.points,
        scores: &query.scores,
        tile_points: &tile_points,
    };
    let pairs = keypoints.pairs(&scratch.matches);
    let estimated = estimate(&pairs, &estimation);
    let guided = estimated
        .as_ref()
        .filter(|_| options.guided)
        .and_then(|start| {
            match_guided(
                &mut similarities,
                &keypoints,
                &scratch.matches,
                start,
                &estimation,
                &mut scratch.guided,
            )
        });
    let threshold_px = estimation.ransac.threshold_px;
    let (estimated, pairs) = match guided {
        Some((guided, guided_pairs)) => (Some(guided), guided_pairs),
        None => (estimated, pairs),
    };
    let expected_inliers = estimated.as_ref().map_or(0.0, |estimated| {
        expected_inliers(&estimated.homography, &keypoints, threshold_px)
    });
    Ok(MatchedTile {
        estimated,
        pairs,
        expected_inliers,
    })
}

fn centre_covariance(
    estimated: &EstimatedTransform,
    pairs: &[Correspondence],
    centre_px: QueryPx,
) -> Option<Matrix2<f64>> {
    let centre = Point2::from(centre_px);
    let agreeing: Vec<Correspondence> = estimated
        .inliers
        .iter()
        .map(|&index| pairs[index])
        .collect();
    match &estimated.similarity {
        Some(similarity) => {
            mapped_point_covariance(similarity, &agreeing, centre, MIN_RESIDUAL_SIGMA_PX)
        }
        None => mapped_point_covariance(
            &estimated.homography,
            &agreeing,
            centre,
            MIN_RESIDUAL_SIGMA_PX,
        ),
    }
}

fn check_gates(
    verified: &VerifiedCandidate,
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
    gates.check_shape(transform, query.centre_px.into(), 1.0)?;
    let LevelPx { x, y } = verified.centre_level_px.ok_or(Rejection::NotFinite)?;
    let [width, height] = level.size_px();
    if !((0.0..=width as f64).contains(&x) && (0.0..=height as f64).contains(&y)) {
        return Err(Rejection::OutsideMap);
    }
    if verified.covariance_px2.is_none() {
        return Err(Rejection::NotFinite);
    }
    Ok(())
}
