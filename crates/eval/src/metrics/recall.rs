//! Recall: how often the search ranks a tile of the true place among its first K.
//!
//! A tile is right if it covers the true image centre; beside it the paper's definition, its centre within a radius of the truth
//! (64 pixels), which a tiling at half overlap can meet for a fifth of all places only.

use grimnet_geo::{LevelPx, LonLat};
use grimnet_locate::{RoundTrace, Trace};
use grimnet_pack::Pack;
use serde::Serialize;

/// The K for which recall is reported.
pub const RECALL_AT: [usize; 6] = [1, 2, 5, 10, 50, 100];

/// The largest K.
pub const MOST_RANKS: usize = RECALL_AT[RECALL_AT.len() - 1];

/// The paper's radius about the truth, pixels of the level (section 4.2).
pub const PAPER_RADIUS_PX: f64 = 64.0;

/// When a retrieved tile counts as right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RightTile {
    /// It covers the true centre.
    Covers,
    /// Its centre lies within this many level pixels of the true centre.
    CentreWithinPx(f64),
}

impl RightTile {
    /// The paper's definition.
    pub const PAPER: Self = Self::CentreWithinPx(PAPER_RADIUS_PX);

    /// Returns whether a tile of side `tile_px` (level pixels) around `centre_px` is right for `truth_px`.
    #[must_use]
    pub fn holds(self, centre_px: LevelPx, tile_px: f64, truth_px: LevelPx) -> bool {
        let (dx, dy) = (
            (centre_px.x - truth_px.x).abs(),
            (centre_px.y - truth_px.y).abs(),
        );
        match self {
            Self::Covers => dx.max(dy) <= tile_px / 2.0,
            Self::CentreWithinPx(radius) => dx.hypot(dy) <= radius,
        }
    }
}

/// Rank of the first right tile in the search for one photo.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct FrameRecall {
    /// Rank by descriptor, from 1; `None` if no right tile was retrieved.
    pub rank_by_descriptor: Option<usize>,
    /// Rank by descriptor and by the votes over the whole map, if the pack has an index of its keypoints.
    pub rank_by_search: Option<usize>,
    /// Rank after the vote over translations.
    pub rank_by_vote: Option<usize>,
    /// Whether any right tile was matched in full.
    pub matched: bool,
}

impl FrameRecall {
    /// Ranks of a photo whose centre is at `truth`. They are of the first round, which is what a single search
    /// would have given; matching may happen in any round.
    #[must_use]
    pub fn of(pack: &Pack, trace: &Trace, truth: LonLat, right: RightTile) -> Self {
        let is_right = |round: &RoundTrace| {
            let level = &pack.levels()[round.level];
            let truth_px = level.level_px_from_lonlat(truth).ok();
            let side_px = f64::from(level.tile_px());
            move |tile: usize| {
                truth_px.is_some_and(|truth_px| {
                    right.holds(level.tile(tile).centre_px, side_px, truth_px)
                })
            }
        };
        let first = trace.rounds.first();
        Self {
            rank_by_descriptor: first.and_then(|r| rank_of_right(&r.by_descriptor, is_right(r))),
            rank_by_search: first.and_then(|r| rank_of_right(&r.by_search, is_right(r))),
            rank_by_vote: first.and_then(|r| rank_of_right(&r.by_vote, is_right(r))),
            matched: trace
                .rounds
                .iter()
                .any(|r| rank_of_right(&r.matched, is_right(r)).is_some()),
        }
    }
}

/// Rank, from 1, of the first right tile.
pub fn rank_of_right(tiles: &[usize], is_right: impl Fn(usize) -> bool) -> Option<usize> {
    tiles
        .iter()
        .position(|&tile| is_right(tile))
        .map(|at| at + 1)
}

/// Recall over all frames, as shares of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Recall {
    /// Frames.
    pub frames: usize,
    /// K of each entry below.
    pub at: Vec<usize>,
    /// Share of frames with a right tile among the first K by descriptor.
    pub by_descriptor: Vec<f64>,
    /// The same by descriptor and by the votes over the whole map.
    pub by_search: Vec<f64>,
    /// The same after the vote over translations.
    pub by_vote: Vec<f64>,
    /// Share of frames of which a right tile was matched in full.
    pub matched: f64,
}

impl Recall {
    /// Means over frames for each K of `at`.
    #[must_use]
    pub fn of(frames: &[FrameRecall], at: &[usize]) -> Self {
        let share = |count: usize| count as f64 / frames.len().max(1) as f64;
        let within = |rank: fn(&FrameRecall) -> Option<usize>| {
            at.iter()
                .map(|&k| {
                    share(
                        frames
                            .iter()
                            .filter(|f| rank(f).is_some_and(|r| r <= k))
                            .count(),
                    )
                })
                .collect()
        };
        Self {
            frames: frames.len(),
            at: at.to_vec(),
            by_descriptor: within(|f| f.rank_by_descriptor),
            by_search: within(|f| f.rank_by_search),
            by_vote: within(|f| f.rank_by_vote),
            matched: share(frames.iter().filter(|f| f.matched).count()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn figures_of_a_case_done_by_hand() {
        let frame = |descriptor, vote, matched| FrameRecall {
            rank_by_descriptor: descriptor,
            rank_by_search: descriptor.map(|rank| rank.min(2)),
            rank_by_vote: vote,
            matched,
        };
        let frames = [
            frame(Some(1), Some(1), true),
            frame(Some(7), Some(1), true),
            frame(Some(3), Some(12), false),
            frame(None, None, false),
        ];
        let recall = Recall::of(&frames, &[1, 5, 10]);
        assert_eq!(recall.by_descriptor, [0.25, 0.5, 0.75]);
        assert_eq!(recall.by_search, [0.25, 0.75, 0.75]);
        assert_eq!(recall.by_vote, [0.5, 0.5, 0.5]);
        assert_relative_eq!(recall.matched, 0.5);
        assert_eq!(Recall::of(&[], &[1]).by_vote, [0.0]);
    }

    #[test]
    fn right_is_covering_or_near() {
        let centre = LevelPx::new(512.0, 512.0);
        assert!(RightTile::Covers.holds(centre, 512.0, LevelPx::new(256.0, 700.0)));
        assert!(!RightTile::Covers.holds(centre, 512.0, LevelPx::new(255.0, 512.0)));
        assert!(RightTile::CentreWithinPx(64.0).holds(centre, 512.0, LevelPx::new(512.0, 576.0)));
        assert!(!RightTile::CentreWithinPx(64.0).holds(centre, 512.0, LevelPx::new(560.0, 560.0)));
        assert_eq!(rank_of_right(&[4, 9, 2], |tile| tile == 2), Some(3));
        assert_eq!(rank_of_right(&[4, 9], |tile| tile == 2), None);
    }
}
