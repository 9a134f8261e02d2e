//! Candidates: tiles found by descriptor, and the translation vote over them.

use grimnet_geo::{LonLat, distance_m};
use grimnet_pack::Level;
use nalgebra::Point2;
use rayon::prelude::*;

use crate::{
    error::Result,
    options::{Options, VoteOptions},
    prior::Near,
    query_features::QueryFeatures,
    search::matching::Descriptors,
    search::{scratch::ScratchPool, vote::Peak},
};

/// A tile that may show one of the queries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Index of the query among those of the round.
    pub query: usize,
    /// Index of the tile in its level.
    pub tile: usize,
    /// Similarity of the global descriptors.
    pub similarity: f32,
    /// The peak of the translation vote; without votes until [`vote`] was called.
    pub peak: Peak,
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
    let index = options.index.unwrap_or_else(|| level.index());
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

/// For each tile, whether it may show a part of the area.
fn allowed_tiles(level: &Level, near: &Near) -> Result<Vec<bool>> {
    let reach_m = near.radius_m + level.tile_m() * std::f64::consts::FRAC_1_SQRT_2;
    (0..level.tile_count())
        .map(|tile| {
            let centre: LonLat = level.lonlat_from_level_px(level.tile(tile).centre_px)?;
            Ok(distance_m(centre, near.centre) <= reach_m)
        })
        .collect()
}

/// Lets the matches of the strongest `keypoints` of each candidate vote for a translation. The candidates are left in the order of
/// their tiles, each of which is read once for all of its queries.
pub(crate) fn vote(
    level: &Level,
    queries: &[QueryFeatures],
    candidates: &mut [Candidate],
    keypoints: usize,
    scratch: &ScratchPool,
    options: &VoteOptions,
) -> Result<()> {
    candidates.sort_unstable_by_key(|candidate| (candidate.tile, candidate.query));
    let by_tile = candidates.par_chunk_by_mut(|a, b| a.tile == b.tile);
    by_tile.try_for_each(|candidates| {
        let tile = level.strongest_features(candidates[0].tile, keypoints)?;
        scratch.with(|scratch| -> Result<()> {
            scratch.points.clear();
            scratch
                .points
                .extend(tile.xy_px.iter().map(|&[x, y]| Point2::new(x, y)));
            for candidate in candidates {
                let query = &queries[candidate.query];
                scratch.matcher.mutual(
                    query.strongest(keypoints),
                    Descriptors::from(&tile.descriptors),
                    query.dim,
                    None,
                    &mut scratch.matches,
                )?;
                candidate.peak = scratch.histogram.vote(
                    options,
                    &scratch.matches,
                    &query.points,
                    &scratch.points,
                );
            }
            Ok(())
        })
    })
}

/// The evidence for a candidate: its votes, and the similarity of the global descriptors as so many votes; the similarity alone if
/// there is no vote.
pub(crate) fn evidence(candidate: &Candidate, options: Option<&VoteOptions>) -> f64 {
    let similarity = f64::from(candidate.similarity);
    options.map_or(similarity, |options| {
        f64::from(candidate.peak.votes) + options.similarity_votes * similarity
    })
}

/// Sorts candidates by falling evidence.
pub(crate) fn rank_by_votes(candidates: &mut [Candidate], options: &VoteOptions) {
    candidates.sort_by(|a, b| {
        let [by_a, by_b] = [a, b].map(|candidate| evidence(candidate, Some(options)));
        by_b.total_cmp(&by_a)
            .then(b.similarity.total_cmp(&a.similarity))
            .then((a.query, a.tile).cmp(&(b.query, b.tile)))
    });
}

/// The tiles of candidates in their order, each once: at its first occurrence.
pub(crate) fn distinct_tiles<'a>(
    candidates: impl IntoIterator<Item = &'a Candidate>,
) -> Vec<usize> {
    let mut seen = std::collections::HashSet::new();
    candidates
        .into_iter()
        .map(|candidate| candidate.tile)
        .filter(|&tile| seen.insert(tile))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn similarity_counts_as_votes() {
        let candidate = |tile, similarity, votes| Candidate {
            query: 0,
            tile,
            similarity,
            peak: Peak {
                votes,
                ..Peak::default()
            },
        };
        let order = |similarity_votes| {
            let mut all = vec![
                candidate(0, 0.1, 12),
                candidate(1, 0.5, 10),
                candidate(2, 0.4, 12),
            ];
            let options = VoteOptions {
                similarity_votes,
                ..VoteOptions::default()
            };
            rank_by_votes(&mut all, &options);
            all.iter()
                .map(|candidate| candidate.tile)
                .collect::<Vec<_>>()
        };
        // 12 + 1, 10 + 5 and 12 + 4 votes.
        assert_eq!(order(10.0), [2, 1, 0]);
        assert_eq!(order(0.0), [2, 0, 1]);
    }

    #[test]
    fn a_tile_is_listed_once_at_its_first_occurrence() {
        let candidate = |query, tile| Candidate {
            query,
            tile,
            similarity: 0.0,
            peak: Peak::default(),
        };
        let all = [(0, 7), (1, 7), (1, 3), (0, 3), (0, 9)].map(|(q, t)| candidate(q, t));
        assert_eq!(distinct_tiles(&all), [7, 3, 9]);
    }
}
