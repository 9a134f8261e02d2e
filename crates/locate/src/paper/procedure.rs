//! The paper's procedure: the whole photo at the network's resolution, K tiles by descriptor, the largest inliers / (matches + 1),
//! and linear coordinates (eq. 21-23). It always answers: where no tile has a homography, with the centre of the most similar
//! tile, and where the winning one leads off the Earth, with the centre of its tile (the paper says nothing of such frames).

use std::time::Instant;

use grimnet_geo::{LevelPx, LonLat};
use grimnet_net::Purpose;
use grimnet_pack::resize_for_network;
use grimnet_pack::{Level, Mode, Pack};
use grimnet_photo::{Evidence, Photo, QueryOptions, View};
use image::imageops::{FilterType, resize};
use image::{GrayImage, RgbImage};
use nalgebra::Matrix3;

use crate::{
    context::Context,
    error::{LocateError, Result},
    geometry::{covariance::radius95, transform::Transform},
    options::Coordinates,
    outcome::{EvidenceUsed, Fix, Outcome, Reason, TimeMs, elapsed_ms},
    paper::equations::{MapCorners, TileIndex},
    pipeline::{
        answer::{no_fix, support, tile_ref},
        ground_position::{en_m_from_level_px_jacobian, ground_position, matched_points},
        ranking::{best_candidate, runner_up_inliers},
        run::Located,
        tile_frame::up_bearing_deg,
        verification::{Expected, VerifiedCandidate, verify_with},
    },
    prior::Prior,
    query_features::QueryFeatures,
    search::candidates::{Candidate, by_descriptor, distinct_tiles},
    trace::{RoundTrace, Trace},
};

/// The level that is searched: packs of paper mode have one.
pub(crate) const LEVEL: usize = 0;

/// Localises one photo.
///
/// # Errors
/// [`LocateError::NotAPaperPack`] if the pack was not built in paper mode.
pub(crate) fn locate(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
) -> Result<Located> {
    check_pack(context.pack)?;
    let level_index = LEVEL;
    let level = context.level(level_index);
    let (query, mut time_ms) = extract_query(context, photo, view, level)?;
    let queries = [query];
    let since = Instant::now();
    let candidates = by_descriptor(level, &queries, prior.near.as_ref(), context.options)?;
    time_ms.search = elapsed_ms(since);
    let since = Instant::now();
    let [query] = &queries;
    let verified: Vec<VerifiedCandidate> = candidates
        .iter()
        .map(|&candidate| {
            context.scratch.with(|scratch| {
                let options = context.options;
                verify_with(level, query, candidate, Expected::NOTHING, scratch, options)
            })
        })
        .collect::<Result<_>>()?;
    time_ms.matching = elapsed_ms(since);
    let evidence = evidence(heading_deg(context, view).is_some(), view);
    let by_descriptor = distinct_tiles(&candidates);
    let trace = Trace {
        rounds: vec![RoundTrace {
            level: level_index,
            by_vote: by_descriptor.clone(),
            matched: by_descriptor.clone(),
            by_search: by_descriptor.clone(),
            by_descriptor,
        }],
    };
    Ok(Located {
        outcome: outcome(context, photo, level_index, query, &verified, evidence)?,
        // Frames of a flight are followed in default mode.
        features: None,
        trace,
        time_ms,
    })
}

/// The tiles most similar to a photo, best first.
///
/// # Errors
/// As [`locate`].
pub(crate) fn retrieve(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
) -> Result<Vec<usize>> {
    check_pack(context.pack)?;
    let level = context.level(LEVEL);
    let (query, _) = extract_query(context, photo, view, level)?;
    let found = by_descriptor(level, &[query], prior.near.as_ref(), context.options)?;
    Ok(distinct_tiles(&found))
}

/// Checks that paper mode can use the pack.
///
/// # Errors
/// [`LocateError::NotAPaperPack`] if it was not built in paper mode.
pub(crate) fn check_pack(pack: &Pack) -> Result<()> {
    if pack.mode() == Mode::Paper {
        return Ok(());
    }
    Err(LocateError::NotAPaperPack {
        path: pack.path().to_path_buf(),
    })
}

/// The heading that the photo is turned by, degrees clockwise from true north; `None` in the paper's own procedure.
fn heading_deg(context: Context<'_>, view: &View) -> Option<f64> {
    let heading = view.heading.filter(|_| context.options.turn_by_heading)?;
    Some(heading.heading_deg)
}

/// What was used of what is known of the view: nothing, unless the photo is turned by its heading.
fn evidence(is_turned: bool, view: &View) -> EvidenceUsed {
    if is_turned {
        return EvidenceUsed {
            assumed: Some(
                "paper mode: the photo is turned by its heading; its scale is not used".into(),
            ),
            ..EvidenceUsed::of(view)
        };
    }
    let unused = view
        .used
        .iter()
        .map(|known| Evidence::new(&known.field, &known.value, "paper mode does not use it"));
    EvidenceUsed {
        used: Vec::new(),
        set_aside: unused.chain(view.set_aside.iter().cloned()).collect(),
        assumed: Some("paper mode: neither heading nor scale is used".into()),
    }
}

/// The whole photo as the network sees it in the paper's procedure: resized to the square that it saw of the level's tiles.
#[derive(Debug, Clone)]
pub struct NetworkImage {
    /// The picture, side x side pixels.
    pub rgb: RgbImage,
    /// Zero where a turned photo has black corners; `None` for a photo that was not turned.
    pub mask: Option<GrayImage>,
    /// Photo pixels from pixels of the picture.
    pub photo_px_from_network_px: Matrix3<f64>,
}

/// The picture that the network sees of a photo, turned so that the map's up is up if the options and `view` say so.
///
/// # Errors
/// The photo cannot be resampled, or the map's up direction is not defined.
pub(crate) fn network_image(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    level: &Level,
) -> Result<NetworkImage> {
    let side_px = level.manifest().network_px;
    let scale_from = |(width, height): (u32, u32)| {
        let [x, y] = [width, height].map(|along| f64::from(along) / f64::from(side_px));
        Matrix3::new(x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 1.0)
    };
    let Some(heading_deg) = heading_deg(context, view) else {
        return Ok(NetworkImage {
            rgb: resize_for_network(&photo.image, side_px),
            mask: None,
            photo_px_from_network_px: scale_from(photo.image.dimensions()),
        });
    };
    // No ground resolution is known: a photo of this many units across, a pixel each, is sharp enough to be reduced afterwards.
    let maker = photo.query_maker(&QueryOptions {
        max_side_px: u32::MAX,
        ..QueryOptions::new(1.0, f64::from(2 * side_px))
    })?;
    let turned = maker.make(heading_deg - up_bearing_deg(level)?);
    Ok(NetworkImage {
        rgb: resize_for_network(&turned.image, side_px),
        mask: Some(resize(&turned.mask, side_px, side_px, FilterType::Nearest)),
        photo_px_from_network_px: turned.photo_px_from_query_px
            * scale_from(turned.image.dimensions()),
    })
}

/// The features of the whole photo.
fn extract_query(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    level: &Level,
) -> Result<(QueryFeatures, TimeMs)> {
    let mut time_ms = TimeMs::default();
    let since = Instant::now();
    let image = network_image(context, photo, view, level)?;
    time_ms.query = elapsed_ms(since);
    let since = Instant::now();
    let (query, _) = QueryFeatures::extract(
        (context.extractor, Purpose::Answer),
        &image.rgb,
        image.mask.as_ref(),
        image.photo_px_from_network_px,
        level.descriptor_type(),
        context.options,
    )?;
    time_ms.features = elapsed_ms(since);
    Ok((query, time_ms))
}

fn outcome(
    context: Context<'_>,
    photo: &Photo,
    level_index: usize,
    query: &QueryFeatures,
    verified: &[VerifiedCandidate],
    evidence: EvidenceUsed,
) -> Result<Outcome> {
    let options = context.options;
    let level = context.level(level_index);
    let Some((best, runner_up)) = best_candidate(verified, options) else {
        return Ok(no_fix(Reason::NoTiles, None, evidence));
    };
    if let (Some(_), Some(rejection)) = (&options.gates, best.rejection) {
        return Ok(no_fix(Reason::Rejected(rejection), Some(best), evidence));
    }
    let candidate = best.candidate;
    let mapped = mapped_centre(context, level, query, best)?;
    let centre = match mapped {
        Some(centre) => centre,
        None => tile_centre(context, level, candidate.tile)?,
    };
    let error = &context.model.calibration().position;
    let position = mapped.and_then(|_| {
        ground_position(best, level, query, photo, error, options)
            .ok()
            .flatten()
    });
    let (covariance_en_m2, radius95_m) = match &position {
        Some(position) => (position.covariance_en_m2, position.radius95_m),
        None => uniform_over_tile(level, candidate)?,
    };
    let inlier_covariance_en_m2 = position.as_ref().map_or(covariance_en_m2, |position| {
        position.inlier_covariance_en_m2
    });
    let support = support(
        best,
        query,
        inlier_covariance_en_m2,
        runner_up_inliers(runner_up),
    );
    let full_width_px = f64::from(photo.full_size_px.0.max(1));
    Ok(Outcome::Fix(Box::new(Fix {
        lat_deg: centre.lat_deg,
        lon_deg: centre.lon_deg,
        heading_deg: position.as_ref().map(|position| position.heading_deg),
        gsd_m: position
            .as_ref()
            .map_or(level.tile_m() / full_width_px, |position| position.gsd_m),
        covariance_en_m2,
        radius95_m,
        // The calibration was fitted to answers of the default mode.
        confidence: None,
        support,
        inliers: support.inliers,
        matches: support.matches,
        tile: tile_ref(level_index, level, &candidate),
        runner_up: None,
        outline_lon_lat_deg: position.map_or(Vec::new(), |position| position.outline_lon_lat_deg),
        evidence,
        time_ms: TimeMs::default(),
        drawn: options
            .keep_matches
            .then(|| Box::new(matched_points(best, level, query, photo))),
    })))
}

/// The photo's centre by the transform; `None` without one, or if it maps the centre to no position on Earth.
fn mapped_centre(
    context: Context<'_>,
    level: &Level,
    query: &QueryFeatures,
    best: &VerifiedCandidate,
) -> Result<Option<LonLat>> {
    let centre = match context.options.coordinates {
        Coordinates::Georeference => best
            .centre_level_px
            .and_then(|centre_px| level.lonlat_from_level_px(centre_px).ok()),
        Coordinates::PaperCorners => centre_by_equations(level, query, best)?,
    };
    Ok(centre.filter(LonLat::is_valid))
}

/// The photo's centre through the transform (eq. 21), in pixels of the tile (eq. 22), in degrees (eq. 23); `None` without a transform.
fn centre_by_equations(
    level: &Level,
    query: &QueryFeatures,
    best: &VerifiedCandidate,
) -> Result<Option<LonLat>> {
    let transform = best.transform.as_ref();
    let Some(centre_px) = transform.and_then(|transform| transform.map(query.centre_px.into()))
    else {
        return Ok(None);
    };
    let corners = corners_of(level)?;
    let tile_px = f64::from(level.tile_px());
    let side_px = f64::from(level.manifest().network_px);
    let in_tile_px = MapCorners::tile_px_from_processing_px(
        (centre_px.x, centre_px.y),
        side_px,
        side_px,
        tile_px,
    );
    Ok(Some(corners.lonlat_from_tile_px(
        tile_centre_by_equations(level, &corners, best.candidate.tile),
        in_tile_px,
        tile_px,
    )))
}

/// The centre of a tile, where the photo's own is not known.
fn tile_centre(context: Context<'_>, level: &Level, tile: usize) -> Result<LonLat> {
    match context.options.coordinates {
        Coordinates::Georeference => Ok(level.lonlat_from_level_px(level.tile(tile).centre_px)?),
        Coordinates::PaperCorners => Ok(tile_centre_by_equations(level, &corners_of(level)?, tile)),
    }
}

/// The centre of a tile in degrees (eq. 2a and 2b).
fn tile_centre_by_equations(level: &Level, corners: &MapCorners, tile: usize) -> LonLat {
    let [column, row] = level.tile(tile).grid.map(u64::from);
    corners.tile_centre(
        TileIndex { row, column },
        f64::from(level.tile_px()),
        f64::from(level.manifest().stride_px),
    )
}

/// The size of the level and the corners that its coordinates are linear between.
fn corners_of(level: &Level) -> Result<MapCorners> {
    let [width, height] = level.size_px().map(|side| side as f64);
    let corner = |x: f64, y: f64| {
        level
            .georeference()
            .lonlat_from_map_px(level.map_px_from_level_px(LevelPx::new(x, y)))
    };
    Ok(MapCorners {
        lower_left: corner(0.0, height)?,
        upper_right: corner(width, 0.0)?,
        map_width_px: width,
        map_height_px: height,
    })
}

/// Covariance and 95 % radius of a position that is uniformly distributed over a tile.
fn uniform_over_tile(level: &Level, candidate: Candidate) -> Result<([f64; 3], f64)> {
    let jacobian = en_m_from_level_px_jacobian(level, level.tile(candidate.tile).centre_px)?;
    let covariance = jacobian * jacobian.transpose() * (f64::from(level.tile_px()).powi(2) / 12.0);
    Ok((
        [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
        radius95(&covariance),
    ))
}
