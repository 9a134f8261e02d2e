//! Where the photo may lie: tiles found by descriptor, and the translation vote that ranks them.

use std::sync::{Mutex, PoisonError};

use grimnet_geo::{LonLat, distance_m};
use grimnet_kernels::Isa;
use grimnet_pack::{Index, Level};
use nalgebra::Point2;
use rayon::prelude::*;

use crate::{
    error::Result,
    matching::{Descriptors, Match, Matcher},
    options::{Options, Search},
    prior::Near,
    query_features::QueryFeatures,
    vote::{Histogram, Peak},
};

/// A tile on which one of the queries may lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the query among those of the round.
    pub query: usize,
    /// Index of the tile in its level.
    pub tile: usize,
    /// Similarity of the global descriptors.
    pub similarity: f32,
    /// Where the votes meet; no votes where none was held.
    pub peak: Peak,
}

/// Buffers of one matching thread.
pub(crate) struct Desk {
    pub matcher: Matcher,
    pub matches: Vec<Match>,
    pub guided: Vec<Match>,
    pub histogram: Histogram,
    pub points: Vec<Point2<f32>>,
}

/// Desks that are free.
#[derive(Default)]
pub(crate) struct Desks(Mutex<Vec<Desk>>);

impl Desks {
    /// Lends a desk for the time of `work`.
    pub fn with<R>(&self, work: impl FnOnce(&mut Desk) -> R) -> R {
        let free = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut desk = free.unwrap_or_else(|| Desk {
            matcher: Matcher::new(Isa::detect()),
            matches: Vec::new(),
            guided: Vec::new(),
            histogram: Histogram::default(),
            points: Vec::new(),
        });
        let result = work(&mut desk);
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(desk);
        result
    }
}

impl std::fmt::Debug for Desks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Desks")
    }
}

/// The tiles most similar to each query, best first over all queries.
pub(crate) fn by_descriptor(
    level: &Level,
    queries: &[QueryFeatures],
    near: Option<&Near>,
    options: &Options,
) -> Result<Vec<Candidate>> {
    let globals: Vec<f32> = queries
        .iter()
        .flat_map(|query| query.global.iter().copied())
        .collect();
    if globals.is_empty() || level.tile_count() == 0 {
        return Ok(Vec::new());
    }
    let index = match options.search {
        Search::AsBuilt => level.index(),
        Search::Exact => Index::Exact,
        Search::IvfPq {
            nprobe,
            rerank_factor,
        } => level.index().with_probes(
            nprobe.try_into().unwrap_or(u32::MAX),
            rerank_factor.try_into().unwrap_or(u32::MAX),
        )?,
    };
    let allowed = near.map(|near| allowed_tiles(level, near)).transpose()?;
    let keep = |tile: usize| allowed.as_ref().is_none_or(|allowed| allowed[tile]);
    let found = level.search_with(index, &globals, options.top_k, Some(&keep))?;
    let mut candidates: Vec<Candidate> = found
        .into_iter()
        .enumerate()
        .flat_map(|(query, hits)| {
            hits.into_iter().map(move |hit| Candidate {
                query,
                tile: hit.tile,
                similarity: hit.similarity,
                peak: Peak::default(),
            })
        })
        .collect();
    candidates.sort_by(|a, b| {
        b.similarity
            .total_cmp(&a.similarity)
            .then((a.query, a.tile).cmp(&(b.query, b.tile)))
    });
    Ok(candidates)
}

/// Tiles that may show some of the area.
fn allowed_tiles(level: &Level, near: &Near) -> Result<Vec<bool>> {
    let reach_m = near.radius_m + level.tile_m() * std::f64::consts::FRAC_1_SQRT_2;
    (0..level.tile_count())
        .map(|tile| {
            let centre: LonLat = level.lonlat_from_level_px(level.tile(tile).centre_px)?;
            Ok(distance_m(centre, near.centre) <= reach_m)
        })
        .collect()
}

/// Lets the matches of each candidate vote for one translation.
pub(crate) fn hold_vote(
    level: &Level,
    queries: &[QueryFeatures],
    candidates: &mut [Candidate],
    desks: &Desks,
    options: &Options,
) -> Result<()> {
    let Some(vote) = &options.vote else {
        return Ok(());
    };
    candidates.par_iter_mut().try_for_each(|candidate| {
        let query = &queries[candidate.query];
        let tile = level.strongest_features(candidate.tile, vote.keypoints);
        desks.with(|desk| -> Result<()> {
            let tile_descriptors = Descriptors::I8 {
                values: &tile.descriptors,
                scale: tile.scale,
            };
            desk.matcher.mutual(
                query.strongest(vote.keypoints),
                tile_descriptors,
                query.dim,
                None,
                &mut desk.matches,
            )?;
            desk.points.clear();
            desk.points
                .extend(tile.xy_px.iter().map(|&[x, y]| Point2::new(x, y)));
            candidate.peak = desk
                .histogram
                .vote(vote, &desk.matches, &query.points, &desk.points);
            Ok(())
        })
    })
}

/// Ranks candidates by their votes, ties by similarity.
pub(crate) fn rank_by_votes(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| {
        let by_votes = b.peak.votes.cmp(&a.peak.votes);
        by_votes
            .then(b.similarity.total_cmp(&a.similarity))
            .then((a.query, a.tile).cmp(&(b.query, b.tile)))
    });
}
