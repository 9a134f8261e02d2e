//! SDM@K and PDM@K: how near the first K retrieved tiles lie to the truth, the earlier ranks counted more.
//!
//! Recall@K asks whether a right tile is among the first K. These two ask how far off each of the K is, so that the neighbour of the
//! right tile counts more than a tile at the other end of the map. Rank i of K has the weight K - i + 1, and a tile's score falls from
//! 1 with its distance from the true place of the image centre:
//! - **SDM@K** (Dai et al. 2024, "Vision-Based UAV Self-Positioning in Low-Altitude Urban Environments", IEEE TIP 33,
//!   doi:10.1109/TIP.2023.3346279): exp(-s d), where d is the Euclidean distance of (longitude, latitude) in degrees and s = 5000, as in
//!   `evaluateDistance.py` of the authors' github.com/Dmmm1997/DenseUAV. A tile 22 m to the north scores 1/e, whatever its size.
//! - **PDM@K** (Ye et al. 2026, "Exploring the Best Way for UAV Visual Localization under Low-altitude Multi-view Observation
//!   Condition", CVPR Findings, arXiv 2503.10692): 1 / (1 + exp(lambda (R - alpha))), where R is the distance over the ground divided by
//!   the tile's width, lambda = 6 and alpha = 0.9, as in `run_avl_retrieval_only.py` of the authors' github.com/UAV-AVL/Benchmark. A
//!   tile about the truth scores 0.996.
//!
//! Where fewer than K tiles were retrieved, K is their number, as there; a frame for which none was retrieved scores 0.

use grimnet_geo::{LonLat, distance_m};
use grimnet_locate::{RoundTrace, Trace};
use grimnet_pack::Pack;
use serde::Serialize;

/// SDM's s, per degree.
const SDM_SCALE_PER_DEG: f64 = 5e3;

/// PDM's lambda: how steeply a score falls about [`PDM_ALPHA`].
const PDM_LAMBDA: f64 = 6.0;

/// PDM's alpha: the distance, in widths of the tile, at which a score is one half.
const PDM_ALPHA: f64 = 0.9;

/// Distance of a retrieved tile's centre from the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileDistance {
    /// Euclidean distance of longitude and latitude, degrees.
    pub degrees: f64,
    /// Distance over the ground, in widths of the tile.
    pub widths: f64,
}

impl TileDistance {
    /// From a tile of `tile_m` metres about `centre` to the truth.
    #[must_use]
    pub fn of(centre: LonLat, tile_m: f64, truth: LonLat) -> Self {
        Self {
            degrees: (centre.lon_deg - truth.lon_deg).hypot(centre.lat_deg - truth.lat_deg),
            widths: distance_m(centre, truth) / tile_m,
        }
    }

    fn sdm_score(&self) -> f64 {
        (-SDM_SCALE_PER_DEG * self.degrees).exp()
    }

    fn pdm_score(&self) -> f64 {
        1.0 / (1.0 + (PDM_LAMBDA * (self.widths - PDM_ALPHA)).exp())
    }
}

/// SDM@K of tiles in the order of their ranks.
#[must_use]
pub fn sdm_at(tiles: &[TileDistance], k: usize) -> f64 {
    mean_by_rank(tiles, k, TileDistance::sdm_score)
}

/// PDM@K of tiles in the order of their ranks.
#[must_use]
pub fn pdm_at(tiles: &[TileDistance], k: usize) -> f64 {
    mean_by_rank(tiles, k, TileDistance::pdm_score)
}

/// Mean score of the first `k`, the first weighing `k` and the last 1; 0 of none.
fn mean_by_rank(tiles: &[TileDistance], k: usize, score: fn(&TileDistance) -> f64) -> f64 {
    let k = k.min(tiles.len());
    let weighted = tiles[..k]
        .iter()
        .enumerate()
        .map(|(i, tile)| (k - i) as f64 * score(tile));
    let weights = (k * (k + 1)) as f64 / 2.0;
    weighted.sum::<f64>() / weights.max(1.0)
}

/// Distances of the tiles that were retrieved for one frame, in the order of their ranks.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameDistances {
    /// Ranked by descriptor.
    pub by_descriptor: Vec<TileDistance>,
    /// Ranked by the vote over translations.
    pub by_vote: Vec<TileDistance>,
}

impl FrameDistances {
    /// Distances of the first `most` tiles of the search for a photo whose centre is at `truth`, in its first round, which is what a
    /// single search would have given.
    #[must_use]
    pub fn of(pack: &Pack, trace: &Trace, truth: LonLat, most: usize) -> Self {
        let Some(first) = trace.rounds.first() else {
            return Self::default();
        };
        let distances =
            |tiles: &[usize]| distances(pack, first, &tiles[..most.min(tiles.len())], truth);
        Self {
            by_descriptor: distances(&first.by_descriptor),
            by_vote: distances(&first.by_vote),
        }
    }
}

fn distances(pack: &Pack, round: &RoundTrace, tiles: &[usize], truth: LonLat) -> Vec<TileDistance> {
    let level = &pack.levels()[round.level];
    // A centre without longitude and latitude counts as infinitely far.
    const NOWHERE: TileDistance = TileDistance {
        degrees: f64::INFINITY,
        widths: f64::INFINITY,
    };
    tiles
        .iter()
        .map(|&tile| {
            level
                .lonlat_from_level_px(level.tile(tile).centre_px)
                .map_or(NOWHERE, |centre| {
                    TileDistance::of(centre, level.tile_m(), truth)
                })
        })
        .collect()
}

/// SDM@K and PDM@K, means over all frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RankDistance {
    /// K of each entry below.
    pub at: Vec<usize>,
    /// SDM@K by descriptor.
    pub sdm_by_descriptor: Vec<f64>,
    /// SDM@K after the vote.
    pub sdm_by_vote: Vec<f64>,
    /// PDM@K by descriptor.
    pub pdm_by_descriptor: Vec<f64>,
    /// PDM@K after the vote.
    pub pdm_by_vote: Vec<f64>,
}

impl RankDistance {
    /// Means over frames for each K of `at`.
    #[must_use]
    pub fn of(frames: &[FrameDistances], at: &[usize]) -> Self {
        let mean = |score: &dyn Fn(&FrameDistances, usize) -> f64| -> Vec<f64> {
            let over = |k| frames.iter().map(|f| score(f, k)).sum::<f64>();
            at.iter()
                .map(|&k| over(k) / frames.len().max(1) as f64)
                .collect()
        };
        Self {
            at: at.to_vec(),
            sdm_by_descriptor: mean(&|f, k| sdm_at(&f.by_descriptor, k)),
            sdm_by_vote: mean(&|f, k| sdm_at(&f.by_vote, k)),
            pdm_by_descriptor: mean(&|f, k| pdm_at(&f.by_descriptor, k)),
            pdm_by_vote: mean(&|f, k| pdm_at(&f.by_vote, k)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn tile(degrees: f64, widths: f64) -> TileDistance {
        TileDistance { degrees, widths }
    }

    #[test]
    fn figures_of_a_case_done_by_hand() {
        // Scores: SDM 1, 1/e, 1/e^2; PDM 1/(1 + e^-5.4), 1/2, 1/(1 + e^0.6).
        let tiles = [tile(0.0, 0.0), tile(2e-4, 0.9), tile(4e-4, 1.0)];
        let e = std::f64::consts::E;
        assert_relative_eq!(sdm_at(&tiles, 1), 1.0);
        assert_relative_eq!(sdm_at(&tiles, 2), (2.0 + 1.0 / e) / 3.0, epsilon = 1e-12);
        let third = (3.0 + 2.0 / e + 1.0 / (e * e)) / 6.0;
        assert_relative_eq!(sdm_at(&tiles, 3), third, epsilon = 1e-12);
        assert_relative_eq!(sdm_at(&tiles, 10), third, epsilon = 1e-12);
        assert_relative_eq!(pdm_at(&tiles, 1), 0.995_503_7, epsilon = 1e-7);
        assert_relative_eq!(
            pdm_at(&tiles, 3),
            (3.0 * 0.995_503_7 + 2.0 * 0.5 + 0.354_343_7) / 6.0,
            epsilon = 1e-7
        );
        assert_eq!((sdm_at(&[], 5), pdm_at(&[], 5)), (0.0, 0.0));
        assert_eq!(pdm_at(&[tile(f64::INFINITY, f64::INFINITY)], 1), 0.0);
    }

    #[test]
    fn the_order_of_ranks_counts_and_a_frame_without_tiles_scores_nothing() {
        let good_first = vec![tile(0.0, 0.0), tile(1e-3, 3.0)];
        let good_last: Vec<_> = good_first.iter().rev().copied().collect();
        assert_relative_eq!(sdm_at(&good_first, 2), 2.0 / 3.0, epsilon = 1e-2);
        assert_relative_eq!(sdm_at(&good_last, 2), 1.0 / 3.0, epsilon = 1e-2);
        let frames = [
            FrameDistances {
                by_descriptor: good_last,
                by_vote: good_first,
            },
            FrameDistances::default(),
        ];
        let means = RankDistance::of(&frames, &[1]);
        assert!(means.pdm_by_vote[0] > 0.49 && means.pdm_by_descriptor[0] < 1e-5);
        assert_relative_eq!(means.sdm_by_vote[0], 0.5);
        assert_eq!(RankDistance::of(&[], &[1]).sdm_by_vote, [0.0]);
    }

    #[test]
    fn a_tile_22_m_north_scores_1_over_e() {
        let truth = LonLat::new(13.4, 52.5);
        let north = LonLat::new(13.4, 52.5002);
        let far = TileDistance::of(north, 44.5, truth);
        assert_relative_eq!(far.sdm_score(), (-1.0f64).exp(), epsilon = 1e-9);
        assert_relative_eq!(far.widths, 0.5, epsilon = 1e-3);
    }
}
