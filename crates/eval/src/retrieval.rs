//! Retrieval figures of one run: recall, and distances of the retrieved tiles by rank.

use grimnet_pack::Pack;
use serde::Serialize;

use crate::evaluation::Trial;
use crate::metrics::rank_distance::{FrameDistances, RankDistance};
use crate::metrics::recall::{FrameRecall, MOST_RANKS, RECALL_AT, Recall, RightTile};
use crate::scene::Shot;

/// Retrieval figures of one run.
#[derive(Debug, Clone, Serialize)]
pub struct RetrievalSummary {
    /// The run, such as "heading known".
    pub run: String,
    /// Tiles in the level of the first photo's first round.
    pub gallery_tiles: usize,
    /// Most tiles that the descriptors of one photo's first round gave: recall among more of them is that among these.
    pub retrieved: usize,
    /// A tile is right if it covers the true centre.
    pub covers: Recall,
    /// A tile is right if its centre is within `radius_px` of the true centre.
    pub near: Recall,
    /// Radius of `near`, pixels of the level.
    pub radius_px: f64,
    /// SDM@K and PDM@K: how near the first K tiles are to the true centre.
    pub distance: RankDistance,
    /// Rank of the first covering tile, photo by photo.
    pub frames: Vec<PhotoRecall>,
}

/// Ranks of one photo.
#[derive(Debug, Clone, Serialize)]
pub struct PhotoRecall {
    /// File name of the photo.
    pub photo: String,
    /// Rank of its first covering tile.
    #[serde(flatten)]
    pub ranks: FrameRecall,
}

impl RetrievalSummary {
    /// Compares the searches of a run with the truth; a photo without a search counts as one whose tile was not found.
    #[must_use]
    pub fn of(run: &str, pack: &Pack, shots: &[Shot], trials: &[Trial], radius_px: f64) -> Self {
        let searches = || {
            shots.iter().zip(trials).map(|(shot, trial)| {
                let trace = trial.found.as_ref().ok().and_then(|f| f.trace.as_ref());
                (shot.truth.position, trace)
            })
        };
        let ranks = |right| -> Vec<FrameRecall> {
            searches()
                .map(|(truth, trace)| {
                    trace.map_or_else(FrameRecall::default, |trace| {
                        FrameRecall::of(pack, trace, truth, right)
                    })
                })
                .collect()
        };
        let covering = ranks(RightTile::Covers);
        let level = searches()
            .find_map(|(_, trace)| trace?.rounds.first())
            .map_or(0, |round| round.level);
        let distances: Vec<FrameDistances> = searches()
            .map(|(truth, trace)| {
                trace.map_or_else(FrameDistances::default, |trace| {
                    FrameDistances::of(pack, trace, truth, MOST_RANKS)
                })
            })
            .collect();
        Self {
            run: run.to_owned(),
            gallery_tiles: pack.levels()[level].tile_count(),
            retrieved: searches()
                .filter_map(|(_, trace)| Some(trace?.rounds.first()?.by_descriptor.len()))
                .max()
                .unwrap_or(0),
            covers: Recall::of(&covering, &RECALL_AT),
            near: Recall::of(&ranks(RightTile::CentreWithinPx(radius_px)), &RECALL_AT),
            radius_px,
            distance: RankDistance::of(&distances, &RECALL_AT),
            frames: shots
                .iter()
                .zip(covering)
                .map(|(shot, ranks)| PhotoRecall {
                    photo: shot.name.clone(),
                    ranks,
                })
                .collect(),
        }
    }
}
