//! The paper's way: the whole photo at the network's resolution, K tiles by descriptor, the largest inliers / (matches + 1), and
//! linear coordinates (equations 22 and 23). Always an answer.

use std::time::Instant;

use grimnet_geo::{LevelPx, LonLat, MapPx, PaperCorners, PaperTile};
use grimnet_pack::{Level, Mode as PackMode};
use grimnet_photo::{Photo, View};
use image::imageops::{FilterType, resize};
use nalgebra::Matrix3;

use crate::{
    answer::{no_fix, support},
    candidates::{Candidate, by_descriptor},
    covariance::radius95,
    error::{LocateError, Result},
    localizer::Localizer,
    options::Coordinates,
    outcome::{EvidenceUsed, Fix, Outcome, Reason, TileRef, TimeMs, elapsed_ms},
    place::{en_m_from_level_px_jacobian, matched_points, place},
    prior::Prior,
    query_features::QueryFeatures,
    ranking::{best_among, runner_up_inliers},
    solve::Expected,
    trace::{RoundTrace, Trace, tiles_of},
    transform::Transform,
    verify::{Verified, verify},
};

impl Localizer {
    /// One photo by the paper's recipe.
    pub(crate) fn locate_as_paper(
        &self,
        photo: &Photo,
        view: &View,
        prior: &Prior,
        time_ms: &mut TimeMs,
    ) -> Result<(Outcome, Trace)> {
        if self.pack.mode() != PackMode::Paper {
            return Err(LocateError::NotAPaperPack {
                path: self.pack.path().to_path_buf(),
            });
        }
        let level_index = view.footprint.map_or(0, |footprint| {
            self.pack
                .nearest_level(footprint.width_m / self.options.query_width_px)
        });
        let level = &self.pack.levels()[level_index];
        let since = Instant::now();
        let side = level.manifest().network_px;
        let image = resize(&photo.image, side, side, FilterType::Triangle);
        let (width, height) = photo.image.dimensions();
        let [x, y] = [width, height].map(|along| f64::from(along) / f64::from(side));
        let photo_px_from_query_px = Matrix3::new(x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 1.0);
        time_ms.query += elapsed_ms(since);
        let since = Instant::now();
        let query = QueryFeatures::extract(
            &self.extractor,
            &image,
            None,
            photo_px_from_query_px,
            &self.options,
        )?;
        time_ms.features += elapsed_ms(since);

        let since = Instant::now();
        let queries = [query];
        let candidates = by_descriptor(level, &queries, prior.near.as_ref(), &self.options)?;
        time_ms.search += elapsed_ms(since);
        let since = Instant::now();
        let expected = Expected {
            max_rotation_rad: f64::INFINITY,
        };
        let verified: Vec<Verified> = candidates
            .iter()
            .map(|&candidate| {
                self.desks.with(|desk| {
                    verify(level, &queries[0], candidate, expected, desk, &self.options)
                })
            })
            .collect::<Result<_>>()?;
        time_ms.matching += elapsed_ms(since);
        let evidence = EvidenceUsed {
            assumed: Some("the paper's recipe: neither heading nor scale".into()),
            ..EvidenceUsed::of(view)
        };
        let by_descriptor = tiles_of(&candidates);
        let trace = Trace {
            rounds: vec![RoundTrace {
                level: level_index,
                by_vote: by_descriptor.clone(),
                matched: by_descriptor.clone(),
                by_descriptor,
            }],
        };
        let outcome = self.answer_as_paper(photo, level_index, &queries[0], &verified, evidence)?;
        Ok((outcome, trace))
    }

    fn answer_as_paper(
        &self,
        photo: &Photo,
        level_index: usize,
        query: &QueryFeatures,
        verified: &[Verified],
        evidence: EvidenceUsed,
    ) -> Result<Outcome> {
        let level = &self.pack.levels()[level_index];
        let Some((best, runner_up)) = best_among(verified, &self.options) else {
            return Ok(no_fix(Reason::NoTiles, None, evidence));
        };
        if let (Some(_), Some(rejection)) = (&self.options.gates, best.rejection) {
            return Ok(no_fix(Reason::Rejected(rejection), Some(best), evidence));
        }
        // A transform may send the centre to where there are no degrees; the retrieved tile is then all that is known.
        let error = &self.model.calibration().position;
        let found = place(best, level, query, photo, error, &self.options)
            .ok()
            .flatten();
        let center = self
            .center_as_paper(level, query, best)?
            .filter(LonLat::is_valid);
        let candidate = best.candidate;
        let (center, from_transform) = match center.zip(found) {
            Some((center, place)) => (center, Some(place)),
            None => (
                level.lonlat_from_level_px(level.tile(candidate.tile).centre_px)?,
                None,
            ),
        };
        let (covariance_en_m2, radius95_m) = match &from_transform {
            Some(place) => (place.covariance_en_m2, place.radius95_m),
            None => uniform_over_tile(level, candidate)?,
        };
        let inlier_covariance_en_m2 = from_transform
            .as_ref()
            .map_or(covariance_en_m2, |place| place.inlier_covariance_en_m2);
        let runner_up_inliers = runner_up_inliers(runner_up);
        let support = support(best, query, inlier_covariance_en_m2, runner_up_inliers);
        Ok(Outcome::Fix(Box::new(Fix {
            lat_deg: center.lat_deg,
            lon_deg: center.lon_deg,
            heading_deg: from_transform
                .as_ref()
                .map_or(0.0, |place| place.heading_deg),
            gsd_m: from_transform.as_ref().map_or(
                level.tile_m() / f64::from(photo.full_size_px.0.max(1)),
                |place| place.gsd_m,
            ),
            covariance_en_m2,
            radius95_m,
            confidence: self.confidence(&support),
            support,
            inliers: support.inliers,
            matches: support.matches,
            tile: TileRef::of(level_index, level, &candidate),
            runner_up: None,
            outline_lonlat_deg: from_transform.map_or(Vec::new(), |place| place.outline_lonlat_deg),
            evidence,
            time_ms: TimeMs::default(),
            drawn: self
                .options
                .keep_matches
                .then(|| Box::new(matched_points(best, level, query, photo))),
        })))
    }

    /// The photo's centre by equations 22 and 23, or by the georeference where the options say so.
    fn center_as_paper(
        &self,
        level: &Level,
        query: &QueryFeatures,
        best: &Verified,
    ) -> Result<Option<LonLat>> {
        let Some(centre_px) = best.centre_level_px else {
            return Ok(None);
        };
        if self.options.coordinates == Coordinates::Georeference {
            return Ok(level.lonlat_from_level_px(centre_px.into()).ok());
        }
        let Some(in_tile) = best
            .transform
            .as_ref()
            .and_then(|transform| transform.map(query.centre))
        else {
            return Ok(None);
        };
        let [width, height] = level.size_px().map(|side| side as f64);
        let corner = |x: f64, y: f64| {
            level
                .georeference()
                .lonlat_from_map_px(self.map_corner(level, x, y))
        };
        let corners = PaperCorners {
            lower_left: corner(0.0, height)?,
            upper_right: corner(width, 0.0)?,
            map_width_px: width,
            map_height_px: height,
        };
        let tile = level.tile(best.candidate.tile);
        let tile_px = f64::from(level.tile_px());
        let stride_px = f64::from(level.manifest().stride_px);
        let side = f64::from(level.manifest().network_px);
        let place = PaperTile {
            row: u64::from(tile.grid[1]),
            column: u64::from(tile.grid[0]),
        };
        let in_tile_px =
            PaperCorners::tile_px_from_processing_px((in_tile.x, in_tile.y), side, side, tile_px);
        Ok(Some(corners.lonlat_from_tile_px(
            corners.tile_centre(place, tile_px, stride_px),
            in_tile_px,
            tile_px,
        )))
    }

    fn map_corner(&self, level: &Level, x: f64, y: f64) -> MapPx {
        level.map_px_from_level_px(LevelPx::new(x, y))
    }
}

/// Covariance and 95 % radius of a position anywhere on a tile.
fn uniform_over_tile(level: &Level, candidate: Candidate) -> Result<([f64; 3], f64)> {
    let jacobian = en_m_from_level_px_jacobian(level, level.tile(candidate.tile).centre_px)?;
    let covariance = jacobian * jacobian.transpose() * (f64::from(level.tile_px()).powi(2) / 12.0);
    Ok((
        [covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]],
        radius95(&covariance),
    ))
}
