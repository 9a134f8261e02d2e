//! Candidates: tiles found by descriptor and by votes over the whole map, and the translation vote over them.

use std::collections::{BTreeMap, HashMap, HashSet};

use grimnet_geo::{LevelPx, LonLat, distance_m};
use grimnet_pack::{KeypointIndex, Level};
use nalgebra::Point2;
use rayon::prelude::*;

use crate::{
    error::Result,
    options::{MapVoteOptions, Options, VoteOptions},
    prior::Near,
    query_features::QueryFeatures,
    search::{
        map_vote::{Place, map_vote},
        matching::Descriptors,
        scratch::ScratchPool,
        vote::Peak,
    },
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
    /// By what candidates enter the search: the similarity, and the votes over the whole map as similarity ([`join_map_votes`]).
    pub score: f32,
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
    let allowed = allowed_tiles(level, near)?;
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
                score: hit.similarity,
                peak: Peak::default(),
            })
        })
        .collect();
    sort_by_score(&mut candidates);
    Ok(candidates)
}

fn sort_by_score(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| {
        b.score
            .total_cmp(&a.score)
            .then((a.query, a.tile).cmp(&(b.query, b.tile)))
    });
}

/// Adds the tiles with the most votes over the whole map to candidates found by descriptor, and orders all by both. Candidates that are
/// `taken` are left out.
pub(crate) fn join_map_votes<'a>(
    (level, index): (&Level, KeypointIndex<'_>),
    queries: &[QueryFeatures],
    near: Option<&Near>,
    candidates: &[Candidate],
    taken: impl Iterator<Item = &'a Candidate>,
    options: &MapVoteOptions,
) -> Result<Vec<Candidate>> {
    let allowed = allowed_tiles(level, near)?;
    let area = allowed.as_ref().map(|allowed| area_of(level, allowed));
    let taken: HashSet<(usize, usize)> = taken.map(|c| (c.query, c.tile)).collect();
    let waiting = candidates.iter().map(|c| ((c.query, c.tile), *c));
    let mut joined: BTreeMap<(usize, usize), Candidate> = waiting.collect();
    for (query, places) in map_vote(level, index, queries, area, options)
        .into_iter()
        .enumerate()
    {
        for Place { tile, votes } in places {
            let is_allowed = allowed.as_ref().is_none_or(|allowed| allowed[tile]);
            if !is_allowed || taken.contains(&(query, tile)) {
                continue;
            }
            let candidate = joined.entry((query, tile)).or_insert_with(|| {
                let similarity = similarity(&queries[query].global, &level.global(tile));
                Candidate {
                    query,
                    tile,
                    similarity,
                    score: similarity,
                    peak: Peak::default(),
                }
            });
            candidate.score += votes / options.similarity_votes as f32;
        }
    }
    let mut joined: Vec<Candidate> = joined.into_values().collect();
    sort_by_score(&mut joined);
    Ok(joined)
}

/// The product of two descriptors.
fn similarity(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The rectangle around the allowed tiles, as two corners; without bounds if there are none.
fn area_of(level: &Level, allowed: &[bool]) -> [LevelPx; 2] {
    let tiles = (0..level.tile_count()).filter(|&tile| allowed[tile]);
    let half = f64::from(level.tile_px()) / 2.0;
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    let around =
        |[low, high]: [f64; 2], along: f64| [low.min(along - half), high.max(along + half)];
    let (x, y) = tiles.fold((none, none), |(x, y), tile| {
        let centre = level.tile(tile).centre_px;
        (around(x, centre.x), around(y, centre.y))
    });
    [0, 1].map(|i| LevelPx { x: x[i], y: y[i] })
}

/// For each tile, whether it may show a part of the given area; `None` if there is none.
fn allowed_tiles(level: &Level, near: Option<&Near>) -> Result<Option<Vec<bool>>> {
    near.map(|near| tiles_near(level, near).collect())
        .transpose()
}

/// Columns and rows of tiles that are looked at together before each of them is.
const BLOCK_TILES: u32 = 32;

/// For each tile, whether it may show a part of the area.
pub(crate) fn tiles_near(level: &Level, near: &Near) -> impl Iterator<Item = Result<bool>> {
    let reach_m = near.radius_m + level.tile_m() * std::f64::consts::FRAC_1_SQRT_2;
    let first = level.centre_px([0, 0]);
    let stride_px = f64::from(level.manifest().stride_px);
    let place = move |[column, row]: [f64; 2]| -> Result<LonLat> {
        let centre_px = first.offset(column * stride_px, row * stride_px);
        Ok(level.lonlat_from_level_px(centre_px)?)
    };
    let tiles = (0..level.tile_count()).map(move |tile| level.tile(tile).grid);
    near_by_blocks(tiles, place, (near.centre, reach_m), BLOCK_TILES)
}

/// For each tile, given by column and row of the tile grid, whether its centre is within `reach_m` of `centre`. `place` gives the centre
/// of a tile, or a point between centres; blocks are of `block_tiles` columns and rows.
///
/// A projection and a geodesic for each tile of a large map would take longer than the search that the area makes smaller.
fn near_by_blocks(
    tiles: impl Iterator<Item = [u32; 2]>,
    place: impl Fn([f64; 2]) -> Result<LonLat>,
    (centre, reach_m): (LonLat, f64),
    block_tiles: u32,
) -> impl Iterator<Item = Result<bool>> {
    let mut far_blocks: HashMap<[u32; 2], bool> = HashMap::new();
    tiles.map(move |tile| {
        let block = tile.map(|along| along / block_tiles);
        let is_far = far_blocks
            .entry(block)
            .or_insert_with(|| is_block_far(block, block_tiles, &place, (centre, reach_m)));
        if *is_far {
            return Ok(false);
        }
        Ok(distance_m(place(tile.map(f64::from))?, centre) <= reach_m)
    })
}

/// Whether the centres of all tiles of a block are farther from `centre` than `reach_m`; false if a corner has no coordinates.
fn is_block_far(
    block: [u32; 2],
    block_tiles: u32,
    place: impl Fn([f64; 2]) -> Result<LonLat>,
    (centre, reach_m): (LonLat, f64),
) -> bool {
    let first = block.map(|along| f64::from(along * block_tiles));
    let last = first.map(|along| along + f64::from(block_tiles - 1));
    let Ok(middle) = place([0, 1].map(|a| 0.5 * (first[a] + last[a]))) else {
        return false;
    };
    let mut half_m = 0.0f64;
    for x in [first[0], last[0]] {
        for y in [first[1], last[1]] {
            let Ok(corner) = place([x, y]) else {
                return false;
            };
            half_m = half_m.max(distance_m(middle, corner));
        }
    }
    // Half as much again, because the sides are not quite straight.
    distance_m(middle, centre) > reach_m + 1.5 * half_m
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
    let level_px_per_query_px = level.px_per_network_px() as f32;
    candidates.sort_unstable_by_key(|candidate| (candidate.tile, candidate.query));
    let by_tile = candidates.par_chunk_by_mut(|a, b| a.tile == b.tile);
    by_tile.try_for_each(|candidates| {
        let tile = level.strongest_features(candidates[0].tile, keypoints)?;
        scratch.with(|scratch| -> Result<()> {
            scratch.points.clear();
            let query_px =
                |level_px: &[f32; 2]| level_px.map(|along| along / level_px_per_query_px);
            let points = tile.xy_px.iter().map(query_px);
            scratch.points.extend(points.map(Point2::from));
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
    let mut seen = HashSet::new();
    candidates
        .into_iter()
        .map(|candidate| candidate.tile)
        .filter(|&tile| seen.insert(tile))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use grimnet_geo::{Affine, Crs, Georeference, MapPx};

    use super::*;

    /// Where the tiles of a map in UTM lie, the axes of which are turned against the grid's.
    fn place_on_turned_map() -> impl Fn([f64; 2]) -> Result<LonLat> {
        let affine = Affine::from_gdal([500_000.0, 0.8, 0.6, 4_982_950.0, 0.6, -0.8]).unwrap();
        let crs = Crs::parse("EPSG:32632").unwrap();
        let map = Georeference::new(affine, crs, (3328, 2560));
        move |grid: [f64; 2]| -> Result<LonLat> {
            let [x, y] = grid.map(|along| 256.0 * (along + 1.0));
            Ok(map.lonlat_from_map_px(MapPx::new(x, y))?)
        }
    }

    #[test]
    fn tiles_are_near_whatever_the_size_of_the_blocks() {
        const COLUMNS: u32 = 12;
        const ROWS: u32 = 9;
        let place = place_on_turned_map();
        // Some tiles of the grid are not stored.
        let tiles: Vec<[u32; 2]> = (0..ROWS)
            .flat_map(|row| (0..COLUMNS).map(move |column| [column, row]))
            .filter(|&[column, row]| (column + 2 * row) % 7 != 3)
            .collect();
        let mut counts = Vec::new();
        for at in [[0.0, 0.0], [5.5, 4.0], [11.0, 8.0], [30.0, -7.0]] {
            let centre = place(at).unwrap();
            for reach_m in [1.0, 300.0, 1000.0, 100_000.0] {
                let is_near = |&tile: &[u32; 2]| {
                    distance_m(place(tile.map(f64::from)).unwrap(), centre) <= reach_m
                };
                let plain: Vec<bool> = tiles.iter().map(is_near).collect();
                for block_tiles in [1, 2, 5, ROWS, COLUMNS, 32] {
                    let area = (centre, reach_m);
                    let by_blocks: Result<Vec<bool>> =
                        near_by_blocks(tiles.iter().copied(), &place, area, block_tiles).collect();
                    let case = format!("{reach_m} m around {at:?}, blocks of {block_tiles}");
                    assert_eq!(by_blocks.unwrap(), plain, "{case}");
                }
                counts.push(plain.iter().filter(|&&near| near).count());
            }
        }
        assert!(counts.contains(&0) && counts.contains(&tiles.len()));
        assert!(counts.iter().any(|near| (2..tiles.len()).contains(near)));
    }

    #[test]
    fn blocks_that_are_far_away_are_not_looked_into() {
        let place = place_on_turned_map();
        let placed = Cell::new(0);
        let counted = |grid: [f64; 2]| {
            placed.set(placed.get() + 1);
            place(grid)
        };
        let tiles = (0..100).flat_map(|row| (0..100).map(move |column| [column, row]));
        let area = (place([3.0, 3.0]).unwrap(), 300.0);
        let near = near_by_blocks(tiles, counted, area, 10).filter(|near| matches!(near, Ok(true)));
        assert_eq!(near.count(), 5, "the tile and its four neighbours");
        // Five points of each of a hundred blocks, and the tiles of a block.
        assert!(placed.get() <= 5 * 100 + 100, "{}", placed.get());
    }

    #[test]
    fn similarity_counts_as_votes() {
        let candidate = |tile, similarity, votes| Candidate {
            query: 0,
            tile,
            similarity,
            score: similarity,
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
            score: 0.0,
            peak: Peak::default(),
        };
        let all = [(0, 7), (1, 7), (1, 3), (0, 3), (0, 9)].map(|(q, t)| candidate(q, t));
        assert_eq!(distinct_tiles(&all), [7, 3, 9]);
    }
}
