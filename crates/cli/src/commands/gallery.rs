//! `grim eval --distractors`: a gallery with foreign tiles, and recall in it.

use std::io::Write;
use std::path::{Path, PathBuf};

#[cfg(feature = "experiments")]
use anyhow::Context;
use anyhow::{Result, ensure};
use clap::Args;
use grimnet_eval::rank_distance::{FrameDistances, RankDistance};
use grimnet_eval::recall::{
    FrameRecall, MOST_RANKS, PAPER_RADIUS_PX, RECALL_AT, Recall, RightTile,
};
use grimnet_eval::truth::TruthFrame;
#[cfg(feature = "experiments")]
use grimnet_experiments::gallery::{Gallery, open_foreign};
use grimnet_geo::{LonLat, Raster};
use grimnet_locate::Trace;
use grimnet_pack::{Levels, Pack};
use serde::Serialize;

/// The K at which SDM@K and PDM@K are printed.
const DISTANCE_AT: [usize; 3] = [1, 5, 10];

/// What makes the gallery harder, and when a retrieved tile is right.
#[derive(Debug, Clone, Args)]
pub struct GalleryOptions {
    /// Add the tiles of this foreign map, or of all pictures in this folder, to the gallery
    #[arg(
        long,
        value_name = "MAP|FOLDER",
        requires = "gsd",
        hide = cfg!(not(feature = "experiments"))
    )]
    pub distractors: Option<PathBuf>,

    /// Only this ground resolution of the map, metres per pixel; distractors without a georeference are taken to have it
    #[arg(long, value_name = "M")]
    pub gsd: Option<f64>,

    /// Also count a retrieved tile as right if its centre lies within this many pixels of the truth
    #[arg(long, value_name = "PX", default_value_t = PAPER_RADIUS_PX)]
    pub recall_radius: f64,
}

impl GalleryOptions {
    /// The map as it is, or with the foreign tiles beside it.
    ///
    /// # Errors
    /// A resolution that means nothing; foreign pictures that cannot be read.
    pub fn lay_out(&self, map: Box<dyn Raster>) -> Result<Box<dyn Raster>> {
        if let Some(gsd_m) = self.gsd {
            ensure!(
                gsd_m.is_finite() && gsd_m > 0.0,
                "--gsd {gsd_m}: must be a positive number of metres per pixel"
            );
        }
        let (Some(path), Some(gsd_m)) = (&self.distractors, self.gsd) else {
            return Ok(map);
        };
        lay_beside(map, path, gsd_m)
    }

    /// The levels to build.
    pub fn levels(&self) -> Levels {
        self.gsd
            .map_or(Levels::Auto, |gsd_m| Levels::Gsd(vec![gsd_m]))
    }
}

/// The map with the foreign tiles of `path` beside it.
#[cfg(feature = "experiments")]
fn lay_beside(map: Box<dyn Raster>, path: &Path, gsd_m: f64) -> Result<Box<dyn Raster>> {
    let foreign = open_foreign(path, gsd_m)?;
    let gallery = Gallery::new(map, foreign, gsd_m, path)
        .with_context(|| format!("cannot add the distractors of {}", path.display()))?;
    tracing::info!("{}", gallery.describe());
    Ok(Box::new(gallery))
}

#[cfg(not(feature = "experiments"))]
fn lay_beside(_: Box<dyn Raster>, _: &Path, _: f64) -> Result<Box<dyn Raster>> {
    anyhow::bail!(super::absent::message("--distractors", "experiments"))
}

/// Recall of one run.
#[derive(Debug, Serialize)]
pub struct RunRecall {
    /// The run, such as "heading known".
    pub run: String,
    /// Tiles in the level of the first frame's first round.
    pub gallery_tiles: usize,
    /// A tile is right if it covers the true centre.
    pub covers: Recall,
    /// A tile is right if its centre lies within `radius_px` of the true centre.
    pub near: Recall,
    /// Radius of `near`, pixels of the level.
    pub radius_px: f64,
    /// SDM@K and PDM@K: how near the first K tiles lie to the true centre.
    pub distance: RankDistance,
    /// Rank of the first covering tile, frame by frame.
    pub frames: Vec<FrameRecall>,
}

impl RunRecall {
    /// Compares what was tried for each frame with the truth.
    pub fn of<'a>(
        run: &str,
        pack: &Pack,
        frames: impl Iterator<Item = (&'a Trace, &'a TruthFrame)> + Clone,
        radius_px: f64,
    ) -> Self {
        let ranks = |right| -> Vec<FrameRecall> {
            frames
                .clone()
                .map(|(trace, truth)| frame_recall(pack, trace, truth, right))
                .collect()
        };
        let covering = ranks(RightTile::Covers);
        let level = frames
            .clone()
            .find_map(|(trace, _)| trace.rounds.first())
            .map_or(0, |round| round.level);
        let distances: Vec<FrameDistances> = frames
            .clone()
            .map(|(trace, truth)| {
                centre_of(truth).map_or_else(FrameDistances::default, |centre| {
                    FrameDistances::of(pack, trace, centre, MOST_RANKS)
                })
            })
            .collect();
        Self {
            run: run.to_owned(),
            gallery_tiles: pack.levels()[level].tile_count(),
            covers: Recall::of(&covering, &RECALL_AT),
            near: Recall::of(&ranks(RightTile::CentreWithinPx(radius_px)), &RECALL_AT),
            radius_px,
            distance: RankDistance::of(&distances, &RECALL_AT),
            frames: covering,
        }
    }
}

fn frame_recall(pack: &Pack, trace: &Trace, truth: &TruthFrame, right: RightTile) -> FrameRecall {
    centre_of(truth).map_or_else(FrameRecall::default, |centre| {
        FrameRecall::of(pack, trace, centre, right)
    })
}

/// The image centre's true place, or the receiver's where no other is known.
fn centre_of(truth: &TruthFrame) -> Option<LonLat> {
    truth
        .centre_lat_lon_deg
        .or(truth.gps_lat_lon_deg)
        .map(|(lat_deg, lon_deg)| LonLat { lon_deg, lat_deg })
}

/// Prints recall, a column a run.
///
/// # Errors
/// Standard output is gone.
pub fn print_recall(runs: &[RunRecall]) -> Result<()> {
    let mut out = std::io::stdout().lock();
    let Some(first) = runs.first() else {
        return Ok(());
    };
    writeln!(
        out,
        "\nrecall among {} tiles (a tile is right if it covers the true centre)",
        first.gallery_tiles
    )?;
    let mut line = |name: &str, cell: &dyn Fn(&RunRecall) -> f64| -> Result<()> {
        write!(out, "{name:<28}")?;
        for run in runs {
            write!(out, "{:>20}", format!("{:.0} %", cell(run) * 100.0))?;
        }
        Ok(writeln!(out)?)
    };
    for (i, k) in RECALL_AT.iter().enumerate() {
        line(&format!("R@{k} by descriptor"), &|r| {
            r.covers.by_descriptor[i]
        })?;
    }
    for (i, k) in RECALL_AT.iter().enumerate() {
        line(&format!("R@{k} after the vote"), &|r| r.covers.by_vote[i])?;
    }
    line("a right tile was matched", &|r| r.covers.matched)?;
    for k in DISTANCE_AT {
        let i = RECALL_AT.iter().position(|&at| at == k).unwrap_or(0);
        line(&format!("SDM@{k} by descriptor"), &|r| {
            r.distance.sdm_by_descriptor[i]
        })?;
        line(&format!("PDM@{k} by descriptor"), &|r| {
            r.distance.pdm_by_descriptor[i]
        })?;
    }
    let five = RECALL_AT.iter().position(|&k| k == 5).unwrap_or(0);
    let radius = first.radius_px;
    line(&format!("R@5, centre within {radius:.0} px"), &|r| {
        r.near.by_descriptor[five]
    })
}
