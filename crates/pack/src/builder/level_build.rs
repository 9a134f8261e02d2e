//! Computes the items of one level and appends them to the journal.

use std::sync::mpsc;

use grimnet_geo::{Raster, RasterPatch};
use grimnet_net::{Domain, ExtractOptions, Extractor, Model, Statistics};

use crate::builder::adapt::adapted_statistics;
use crate::builder::finished_level::FinishedLevel;
use crate::builder::level_plan::{Item, LevelPlan};
use crate::builder::level_state::LevelState;
use crate::builder::progress::{Meter, Phase, Progress};
use crate::builder::recipe::Recipe;
use crate::builder::record::Record;
use crate::builder::resume::{ITEM, STATISTICS};
use crate::builder::unit::Unit;
use crate::error::{PackError, Result};
use crate::options::BuildOptions;
use grimnet_output::Journal;

/// The inputs of one level.
pub struct LevelBuild<'a> {
    pub raster: &'a dyn Raster,
    pub model: &'a Model,
    pub options: &'a BuildOptions,
    pub recipe: &'a dyn Recipe,
    pub plan: LevelPlan,
    /// Index of the level.
    pub number: u32,
}

impl LevelBuild<'_> {
    /// Computes what `state` does not hold yet.
    ///
    /// # Errors
    /// Returns an error if the map cannot be read, the network refuses its input, the journal cannot be written, or `on_progress`
    /// returns one.
    pub fn run(
        self,
        mut state: LevelState,
        journal: &mut Journal,
        meter: &mut Meter,
        on_progress: &mut dyn FnMut(&Progress) -> Result<()>,
    ) -> Result<FinishedLevel> {
        let found = state.tiles.len() as u64;
        meter.resume(state.tiles_done, state.tiles_done - found);
        let items: Vec<Item> = self.plan.items(self.number).collect();
        let keypoints_per_unit = self.recipe.max_keypoints(self.model.spec(), self.options);
        if state.items.len() < items.len() {
            meter.progress.phase = if self.options.adapt {
                Phase::Adapting
            } else {
                Phase::Tiles
            };
            on_progress(&meter.progress)?;
            let extractor = self.extractor(&mut state, journal)?;
            meter.progress.phase = Phase::Tiles;
            let extract = ExtractOptions {
                threshold: self.options.keypoint_threshold,
                max_keypoints: keypoints_per_unit as usize,
                nms_radius_px: self.options.nms_radius_px,
            };
            let remaining = items[state.items.len()..].to_vec();
            self.for_each_patch(remaining, |item, patch| {
                let units = self
                    .recipe
                    .compute_item(&extractor, &extract, &self.plan, &item, &patch)?;
                drop(patch);
                let record = self.record(&mut state, &item, units);
                let place = journal
                    .append(ITEM, &record.to_bytes())
                    .map_err(PackError::of_journal)?;
                state.add(item, place, &record);
                let tiles = self.recipe.tiles_completed_by(&item);
                meter.advance(tiles, tiles - record.tiles.len() as u64);
                on_progress(&meter.progress)
            })?;
        }
        Ok(FinishedLevel {
            plan: self.plan,
            items: state.items,
            tiles: state.tiles,
            keypoints_per_unit,
            statistics: state.statistics,
        })
    }

    /// The network, with statistics of this level if they are to be adapted.
    fn extractor(&self, state: &mut LevelState, journal: &mut Journal) -> Result<Extractor> {
        let own = Extractor::new(self.model, Domain::Sat)?;
        if !self.options.adapt {
            return Ok(own);
        }
        if state.statistics.is_none() {
            let adapted = adapted_statistics(self.raster, &own, &self.plan, self.recipe)?;
            let Some((statistics, tiles)) = adapted else {
                tracing::warn!(
                    level = self.number,
                    "no tile has enough usable pixels to adapt to; the model's statistics are used"
                );
                return Ok(own);
            };
            let bytes = statistics.to_bytes();
            let head = [self.number.to_le_bytes(), tiles.to_le_bytes()].concat();
            journal
                .append(STATISTICS, &[head, bytes.clone()].concat())
                .map_err(PackError::of_journal)?;
            state.statistics = Some((bytes, tiles));
        }
        let bytes = state
            .statistics
            .as_ref()
            .map_or(&[][..], |(bytes, _)| bytes);
        Ok(Extractor::with_statistics(
            self.model,
            Domain::Sat,
            &Statistics::from_bytes(bytes)?,
        )?)
    }

    /// Reads the pixels of each item in a second thread, one item ahead of `each`.
    fn for_each_patch(
        &self,
        items: Vec<Item>,
        mut each: impl FnMut(Item, RasterPatch) -> Result<()>,
    ) -> Result<()> {
        let (raster, plan, recipe) = (self.raster, &self.plan, self.recipe);
        let (sender, receiver) = mpsc::sync_channel(1);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for item in items {
                    let window = recipe.item_window(plan, &item);
                    let [width, height] = window.size_px;
                    let patch = raster.read(plan.map_window(&window), width, height);
                    // The receiver is gone after an error.
                    if sender.send((item, patch)).is_err() {
                        return;
                    }
                }
            });
            // The receiver is dropped with this loop, also if `each` fails, so that the reader ends.
            for (item, patch) in receiver {
                each(item, patch?)?;
            }
            Ok(())
        })
    }

    fn record(&self, state: &mut LevelState, item: &Item, units: Vec<Unit>) -> Record {
        let mut record = Record {
            level: self.number,
            ..Record::default()
        };
        self.recipe.complete_tiles(
            self.model,
            &self.plan,
            item,
            &units,
            &mut state.frontier,
            &mut record,
        );
        for unit in units {
            record.units.push(unit.head);
            record.blobs.extend_from_slice(&unit.blob);
        }
        record
    }
}
