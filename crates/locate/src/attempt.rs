//! One round of the search: queries under each hypothesis, candidates, full matching; and the second look at what it found.

use std::time::Instant;

use grimnet_pack::Level;
use grimnet_photo::{Photo, QueryMaker, QueryOptions, View};
use nalgebra::Vector2;
use rayon::prelude::*;

use crate::{
    candidates::{Candidate, by_descriptor},
    cascade::Cascade,
    error::Result,
    gates::Rejection,
    hypotheses::{Hypothesis, Round},
    localizer::{Localizer, MIN_KEYPOINTS},
    outcome::{TimeMs, elapsed_ms},
    prior::Prior,
    query_features::QueryFeatures,
    ranking::{Best, best_among, is_clear},
    solve::Expected,
    trace::{RoundTrace, tiles_of},
    verify::{Verified, level_px_per_query_px, verify},
};

/// Candidates matched side by side. A constant, so that the answer does not depend on the number of threads.
const BATCH: usize = 4;
/// Turned by more than this, or scaled by more than [`REALIGN_SCALE`], a photo is matched again as the first answer says.
const REALIGN_DEG: f64 = 5.0;
/// See [`REALIGN_DEG`].
const REALIGN_SCALE: f64 = 0.06;

/// A round's hypotheses with their queries, and what matching made of them.
pub(crate) struct Tried {
    pub level: usize,
    pub hypotheses: Vec<Hypothesis>,
    pub queries: Vec<QueryFeatures>,
    pub verified: Vec<Verified>,
    pub about: String,
    pub trace: RoundTrace,
}

impl Localizer {
    /// Queries, candidates and full matching of one round.
    pub(crate) fn try_round(
        &self,
        photo: &Photo,
        view: &View,
        prior: &Prior,
        round: &Round,
        start: Instant,
        time_ms: &mut TimeMs,
    ) -> Result<Tried> {
        let hypotheses = round.hypotheses.clone();
        let level_index = hypotheses.first().map_or(0, |hypothesis| hypothesis.level);
        let level = &self.pack.levels()[level_index];
        let side = self.side_px(&hypotheses);
        let queries = self.queries(photo, view, &hypotheses, side, time_ms)?;
        let enough = queries
            .iter()
            .any(|query| query.points.len() >= MIN_KEYPOINTS);
        let mut verified = Vec::new();
        let mut trace = RoundTrace {
            level: level_index,
            ..RoundTrace::default()
        };
        if enough {
            let since = Instant::now();
            let candidates = by_descriptor(level, &queries, prior.near.as_ref(), &self.options)?;
            time_ms.search += elapsed_ms(since);
            trace.by_descriptor = tiles_of(&candidates);
            let since = Instant::now();
            let mut cascade = Cascade::new(level, &queries, candidates, &self.desks, &self.options);
            loop {
                let batch = cascade.next_batch(BATCH)?;
                if batch.is_empty() {
                    break;
                }
                let more: Vec<Verified> = batch
                    .par_iter()
                    .map(|candidate| self.verify(level, &hypotheses, &queries, *candidate))
                    .collect::<Result<_>>()?;
                verified.extend(more);
                let enough = verified.len() >= self.options.min_matched;
                if enough
                    && (self.is_over_budget(start)
                        || best_among(&verified, &self.options).is_some_and(|(best, runner_up)| {
                            is_clear(best, runner_up, &self.options)
                        }))
                {
                    break;
                }
            }
            time_ms.vote += cascade.vote_ms;
            time_ms.matching += elapsed_ms(since) - cascade.vote_ms;
            let matched: Vec<Candidate> = verified.iter().map(|v| v.candidate).collect();
            trace.matched = tiles_of(&matched);
            let rest: Vec<Candidate> = cascade.into_rest().collect();
            trace.by_vote = tiles_of(matched.iter().chain(&rest));
        }
        Ok(Tried {
            level: level_index,
            hypotheses,
            queries,
            verified,
            about: round.about.clone(),
            trace,
        })
    }

    /// The side that queries are cropped to: less where many headings are tried.
    pub(crate) fn side_px(&self, hypotheses: &[Hypothesis]) -> u32 {
        if hypotheses.len() > 1 {
            self.options.hypothesis_side_px
        } else {
            self.options.query_side_px
        }
    }

    fn verify(
        &self,
        level: &Level,
        hypotheses: &[Hypothesis],
        queries: &[QueryFeatures],
        candidate: Candidate,
    ) -> Result<Verified> {
        let expected = Expected {
            max_rotation_rad: hypotheses[candidate.query].heading_reach_deg.to_radians(),
        };
        let query = &queries[candidate.query];
        self.desks
            .with(|desk| verify(level, query, candidate, expected, desk, &self.options))
    }

    pub(crate) fn queries(
        &self,
        photo: &Photo,
        view: &View,
        hypotheses: &[Hypothesis],
        max_side_px: u32,
        time_ms: &mut TimeMs,
    ) -> Result<Vec<QueryFeatures>> {
        let Some(first) = hypotheses.first() else {
            return Ok(Vec::new());
        };
        let since = Instant::now();
        let maker = self.query_maker(photo, view, first, max_side_px)?;
        let level = &self.pack.levels()[first.level];
        let up_bearing_deg = level
            .georeference()
            .up_bearing_deg(level.georeference().centre_px())?;
        let made: Vec<_> = hypotheses
            .par_iter()
            .map(|hypothesis| maker.make(hypothesis.heading_deg - up_bearing_deg))
            .collect();
        time_ms.query += elapsed_ms(since);
        let since = Instant::now();
        let features = made
            .par_iter()
            .map(|query| {
                QueryFeatures::extract(
                    &self.extractor,
                    &query.image,
                    Some(&query.mask),
                    query.photo_px_from_query_px,
                    &self.options,
                )
            })
            .collect();
        time_ms.features += elapsed_ms(since);
        features
    }

    pub(crate) fn query_maker(
        &self,
        photo: &Photo,
        view: &View,
        hypothesis: &Hypothesis,
        max_side_px: u32,
    ) -> Result<QueryMaker> {
        let level = &self.pack.levels()[hypothesis.level];
        let gsd_m = level.gsd_m() * level_px_per_query_px(level);
        let options = QueryOptions {
            tilt: view.tilt,
            ..QueryOptions::new(gsd_m, hypothesis.width_m)
        };
        let options = QueryOptions {
            max_side_px: options.max_side_px.min(max_side_px),
            ..options
        };
        Ok(photo.query_maker(&options)?)
    }

    /// Matches the best answer again with the photo turned and scaled as it says, and seen in full.
    pub(crate) fn realign(
        &self,
        photo: &Photo,
        view: &View,
        best: &Best<'_>,
        time_ms: &mut TimeMs,
    ) -> Result<Option<Tried>> {
        let query_index = best.verified.candidate.query;
        let (hypothesis, query) = (
            best.tried.hypotheses[query_index],
            &best.tried.queries[query_index],
        );
        let Some(jacobian) = best
            .verified
            .transform
            .as_ref()
            .and_then(|transform| transform.point_jacobian(query.centre))
        else {
            return Ok(None);
        };
        let turned: Vector2<f64> = jacobian * Vector2::new(1.0, 0.0);
        let turn_deg = turned.y.atan2(turned.x).to_degrees();
        let scale = jacobian.determinant().abs().sqrt();
        let cropped = best.tried.hypotheses.len() > 1;
        let worth = cropped || turn_deg.abs() > REALIGN_DEG || (scale - 1.0).abs() > REALIGN_SCALE;
        if !self.options.realign || !worth || !best.verified.rejection.is_none_or(is_support) {
            return Ok(None);
        }
        let hypothesis = Hypothesis {
            width_m: hypothesis.width_m * scale,
            heading_deg: (hypothesis.heading_deg + turn_deg).rem_euclid(360.0),
            heading_reach_deg: 2.0 * REALIGN_DEG,
            ..hypothesis
        };
        let side = self.options.query_side_px;
        let queries = self.queries(photo, view, &[hypothesis], side, time_ms)?;
        let since = Instant::now();
        let level = &self.pack.levels()[best.tried.level];
        let tiles = self.tiles_around(level, best.verified);
        let verified = tiles
            .par_iter()
            .map(|&tile| {
                let candidate = Candidate {
                    query: 0,
                    tile,
                    ..best.verified.candidate
                };
                self.verify(level, &[hypothesis], &queries, candidate)
            })
            .collect::<Result<_>>()?;
        time_ms.matching += elapsed_ms(since);
        Ok(Some(Tried {
            level: best.tried.level,
            hypotheses: vec![hypothesis],
            queries,
            verified,
            about: best.tried.about.clone(),
            trace: RoundTrace::default(),
        }))
    }

    /// The tile of an answer, and the one whose centre is nearest to the answer's.
    fn tiles_around(&self, level: &Level, verified: &Verified) -> Vec<usize> {
        let tile = level.tile(verified.candidate.tile);
        let mut tiles = vec![verified.candidate.tile];
        if let Some(centre) = verified.centre_level_px {
            let stride = f64::from(level.manifest().stride_px);
            let tile_centre = <[f64; 2]>::from(tile.centre_px);
            let step = |axis: usize| {
                (f64::from(tile.grid[axis]) + ((centre[axis] - tile_centre[axis]) / stride).round())
                    .max(0.0) as u32
            };
            tiles.extend(
                level
                    .tile_at([step(0), step(1)])
                    .filter(|&nearest| nearest != verified.candidate.tile),
            );
        }
        tiles
    }
}

/// A gate that more matches could open.
fn is_support(rejection: Rejection) -> bool {
    matches!(
        rejection,
        Rejection::Inliers { .. }
            | Rejection::InlierShare { .. }
            | Rejection::Places { .. }
            | Rejection::Spread { .. }
    )
}
