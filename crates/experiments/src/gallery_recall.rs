//! Recall of the default method on a map with distractors beside it.

use std::path::Path;

use grimnet_eval::evaluation::evaluate;
use grimnet_eval::metrics::recall::{PAPER_RADIUS_PX, RECALL_AT};
use grimnet_eval::retrieval::RetrievalSummary;
use grimnet_eval::scene::{HeadingMode, Scene};
use grimnet_locate::Localizer;
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, Pack};

use crate::bench::{BenchError, at_gsd, pack_of};
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::gallery::{Gallery, GalleryError, open_foreign};

/// Name of the table.
pub const ID: &str = "gallery";

/// Why recall cannot be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GalleryRecallError {
    /// The distractors.
    #[error(transparent)]
    Gallery(#[from] GalleryError),
    /// The pack or the localiser.
    #[error(transparent)]
    Bench(Box<BenchError>),
}

impl From<BenchError> for GalleryRecallError {
    fn from(error: BenchError) -> Self {
        Self::Bench(Box::new(error))
    }
}

/// A measurement of recall among distractors.
#[derive(Debug, Clone, Copy)]
pub struct GalleryRecall<'a> {
    /// The network.
    pub model: &'a Model,
    /// Another map, or a folder of pictures.
    pub distractors: &'a Path,
    /// Ground resolution that is searched, metres per pixel.
    pub gsd_m: f64,
    /// Headings that the localiser is given, a column each.
    pub headings: &'a [HeadingMode],
    /// Folder of the packs.
    pub packs: &'a Path,
}

impl GalleryRecall<'_> {
    /// Localises the photos of each scene, on its map with the distractors beside it.
    ///
    /// # Errors
    /// A distractor cannot be read, or a pack not be built.
    pub fn table(&self, scenes: Vec<Scene>) -> Result<ExperimentTable, GalleryRecallError> {
        let mut runs = Vec::new();
        for scene in scenes {
            runs.extend(self.measure(scene)?);
        }
        let row = |name: String, share: &dyn Fn(&RetrievalSummary) -> f64| {
            let values = runs.iter().map(|(_, run)| Some(100.0 * share(run)));
            Row::new(name, values.collect())
        };
        let mut rows = Vec::new();
        for (i, k) in RECALL_AT.iter().enumerate() {
            rows.extend([
                row(format!("R@{k} by descriptor"), &|r| {
                    r.covers.by_descriptor[i]
                }),
                row(format!("R@{k} after the vote"), &|r| r.covers.by_vote[i]),
                row(
                    format!("R@{k} by descriptor, centre within {PAPER_RADIUS_PX:.0} px"),
                    &|r| r.near.by_descriptor[i],
                ),
                row(format!("SDM@{k} by descriptor"), &|r| {
                    r.distance.sdm_by_descriptor[i]
                }),
                row(format!("PDM@{k} by descriptor"), &|r| {
                    r.distance.pdm_by_descriptor[i]
                }),
            ]);
        }
        rows.push(row("a right tile was matched".to_owned(), &|r| {
            r.covers.matched
        }));
        let tiles: Vec<String> = runs
            .iter()
            .map(|(name, run)| format!("{name}: {} tiles", run.gallery_tiles))
            .collect();
        Ok(ExperimentTable {
            id: ID.to_owned(),
            title: format!("Recall among distractors at {} m per pixel", self.gsd_m),
            columns: runs
                .iter()
                .map(|(name, _)| Column::percent(name.as_str()))
                .collect(),
            rows,
            notes: vec![
                "A tile is right if it covers the true centre, unless said otherwise.".to_owned(),
                format!("Tiles that are searched: {}.", tiles.join(", ")),
            ],
            ..ExperimentTable::default()
        })
    }

    /// The columns of one scene.
    fn measure(&self, scene: Scene) -> Result<Vec<(String, RetrievalSummary)>, GalleryRecallError> {
        let Scene { name, map, shots } = scene;
        let foreign = open_foreign(self.distractors, self.gsd_m)?;
        let gallery = Gallery::new(map, foreign, self.gsd_m, self.distractors)?;
        let options = at_gsd(BuildOptions::standard(), self.gsd_m);
        let path = pack_of(&gallery, self.model, &options, self.packs)?;
        let pack = Pack::open(&path).map_err(BenchError::from)?;
        let localizer = Localizer::new(self.model.clone(), pack).map_err(BenchError::from)?;
        let runs = self.headings.iter().map(|&heading| {
            let trials = evaluate(&localizer, &shots, heading, &mut |_| ());
            let run = heading.name();
            let summary =
                RetrievalSummary::of(run, localizer.pack(), &shots, &trials, PAPER_RADIUS_PX);
            (format!("{name}, {run}"), summary)
        });
        Ok(runs.collect())
    }
}
