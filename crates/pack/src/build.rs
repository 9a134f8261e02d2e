//! Builds a pack from a map: features of every cell or tile, once, offline.
//!
//! Finished work goes to a journal beside the output (`AREA.grim.partial`), so that a build that was stopped at any
//! moment goes on where it was when it is started again with the same map, model and options. The pack itself is put
//! together from the journal (`AREA.grim.assembling`) and renamed; what was there before stays intact until then.

mod adapt;
mod assemble;
mod bilinear;
mod frontier;
mod journal;
mod plan;
mod progress;
mod record;
mod unit;
mod usable;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use grimnet_geo::{Raster, RasterPatch};
use grimnet_net::{Domain, ExtractOptions, Extractor, Model, NetSpec, Statistics, VladSum};

use crate::error::{PackError, Result};
use crate::format::{FORMAT_VERSION, TileEntry};
use crate::manifest::{Manifest, MapSummary, ModelSummary};
use crate::options::{BuildOptions, Mode};
use crate::pack::Pack;
use assemble::FinishedLevel;
use frontier::{CellSum, Frontier};
use journal::{Journal, Kind, Place};
pub use plan::{FINEST_AUTO_GSD_M, HALO_PX};
use plan::{Item, LevelPlan};
use progress::Meter;
pub use progress::{BuildReport, Phase, Progress};
use record::Record;
use unit::Unit;

/// Bytes that a cell may take in the pack, its share of tile descriptors and tables included.
pub const CELL_BUDGET_BYTES: usize = 40 << 10;

/// Bytes of a cell that are neither features nor tile descriptors: unit and tile entries, scale, padding, index.
const CELL_OVERHEAD_BYTES: usize = 256;

/// Builds the pack `out` of a map, or goes on building it. `on_progress` is called after each piece of work.
///
/// The bytes of the result depend on map, model, options and instruction set only: not on the number of threads, nor
/// on how often the build was interrupted. Memory does not grow with the map but for some bytes a tile.
///
/// # Errors
/// Unusable options, a map that cannot be read or has no usable tile, another build of the same pack, a full disk, a
/// folder that cannot be written; what was computed stays for the next run wherever that is possible.
pub fn build(
    raster: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    out: &Path,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<BuildReport> {
    let plans = plan::plan_levels(raster.georeference(), raster.size_px(), options)?;
    let manifest = manifest(raster, model, options)?;
    let mut meter = Meter::new(plans.iter().map(LevelPlan::tile_places).sum());
    if let Some(pack) = finished(out, &manifest.fingerprint) {
        return Ok(report(&pack, &meter, true));
    }
    let mut earlier = Earlier::new(&plans, options.mode, model.spec());
    let mut journal = Journal::open(
        &beside(out, "partial"),
        out,
        &manifest.fingerprint,
        |kind, place, content| Ok(earlier.accept(kind, place, content)),
    )?;
    let mut levels = Vec::new();
    let mut earlier = earlier.levels;
    for (number, plan) in plans.into_iter().enumerate() {
        meter.progress.level = number;
        meter.progress.gsd_m = plan.frame.gsd_m;
        let state = earlier.pop_front().unwrap_or_else(LevelState::new);
        let work = Work {
            raster,
            model,
            options,
            plan,
            number: number as u32,
        };
        levels.push(work.run(state, &mut journal, &mut meter, on_progress)?);
    }
    if levels.iter().all(|level| level.tiles.is_empty()) {
        journal.remove()?;
        let why = format!("{} of nodata or black", meter.progress.tiles_skipped);
        return Err(PackError::Empty {
            path: out.to_path_buf(),
            why,
        });
    }
    meter.progress.phase = Phase::Writing;
    on_progress(&meter.progress);
    let aside = beside(out, "assembling");
    let written = assemble::write_pack(&aside, &mut journal, levels, manifest);
    if let Err(error) = written {
        // The journal stays; half a pack would only fill the disk.
        let _ = fs_err::remove_file(&aside);
        return Err(error);
    }
    fs_err::rename(&aside, out).map_err(|e| PackError::io("write", out, e))?;
    sync_folder(out);
    journal.remove()?;
    Ok(report(&Pack::open(out)?, &meter, false))
}

/// The pack at `out`, if it is whole and made of the same things.
fn finished(out: &Path, fingerprint: &str) -> Option<Pack> {
    out.try_exists().ok().filter(|&there| there)?;
    match Pack::open(out) {
        Ok(pack) => (pack.manifest().fingerprint == fingerprint).then_some(pack),
        Err(error) => {
            tracing::warn!(%error, "what is at the output is no usable pack; it will be replaced");
            None
        }
    }
}

fn report(pack: &Pack, meter: &Meter, was_complete: bool) -> BuildReport {
    let sum = |of: fn(&crate::manifest::LevelManifest) -> u64| {
        pack.manifest().levels.iter().map(of).sum()
    };
    BuildReport {
        path: pack.path().to_path_buf(),
        len_bytes: pack.len_bytes(),
        tiles: sum(|level| level.tiles),
        tiles_skipped: sum(|level| level.tiles_skipped),
        tiles_resumed: meter.progress.tiles_resumed,
        was_complete,
        duration: meter.elapsed(),
    }
}

/// `AREA.grim` -> `AREA.grim.SUFFIX`, in the same folder.
fn beside(out: &Path, suffix: &str) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    name.push(".");
    name.push(suffix);
    PathBuf::from(name)
}

/// Makes the renaming last; not every system can, and the pack is whole either way.
fn sync_folder(out: &Path) {
    let folder = match out.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if let Ok(folder) = std::fs::File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// The manifest but for levels and sections.
fn manifest(raster: &dyn Raster, model: &Model, options: &BuildOptions) -> Result<Manifest> {
    let spec = model.spec();
    let hex = |bytes: [u8; 32]| blake3::Hash::from_bytes(bytes).to_hex().to_string();
    let (width, height) = raster.size_px();
    let georeference = raster.georeference().clone();
    let (x_m, y_m) = georeference.ground_resolution_m(georeference.centre_px())?;
    let json = |e: serde_json::Error| PackError::Options(format!("cannot be written as JSON: {e}"));
    let mut manifest = Manifest {
        format_version: FORMAT_VERSION,
        created_by: concat!("grimnet-pack ", env!("CARGO_PKG_VERSION")).to_owned(),
        fingerprint: String::new(),
        mode: options.mode,
        model: ModelSummary {
            hash: model.hash().to_string(),
            preset: spec.preset.clone(),
            card: serde_json::to_value(model.card()).map_err(json)?,
            descriptor_dim: spec.descriptor_dim,
            global_dim: spec.global_len(),
        },
        map: MapSummary {
            hash: hex(raster.content_hash()?),
            description: raster.describe(),
            size_px: [width, height],
            georeference,
            ground_resolution_m: [x_m, y_m],
        },
        options: options.clone(),
        levels: Vec::new(),
        sections: Vec::new(),
    };
    // Everything that decides about the bytes of the pack.
    let all = serde_json::to_vec(&manifest).map_err(json)?;
    manifest.fingerprint = blake3::hash(&all).to_hex().to_string();
    Ok(manifest)
}

/// Most keypoints of a unit: as the options say, and in default mode no more than fit into the budget.
fn keypoints_per_unit(model: &Model, options: &BuildOptions) -> u32 {
    let spec = model.spec();
    let per_keypoint = spec.descriptor_dim + 6;
    let room =
        CELL_BUDGET_BYTES.saturating_sub(spec.global_len() + CELL_OVERHEAD_BYTES) / per_keypoint;
    match options.mode {
        Mode::Default => options.max_keypoints.min(room.max(1) as u32),
        Mode::Paper => options.max_keypoints,
    }
}

/// How far a level is.
#[derive(Debug)]
struct LevelState {
    items: Vec<(Item, Place)>,
    tiles: Vec<(TileEntry, u64)>,
    frontier: Frontier,
    statistics: Option<(Vec<u8>, u32)>,
    tile_places: u64,
}

impl LevelState {
    fn new() -> Self {
        Self {
            items: Vec::new(),
            tiles: Vec::new(),
            frontier: Frontier::default(),
            statistics: None,
            tile_places: 0,
        }
    }

    /// Notes a record that lies in the journal.
    fn note(&mut self, item: Item, place: Place, record: &Record, global_dim: usize) {
        let first = place.offset + record.globals_offset();
        let at = |i: usize| first + (i * global_dim * size_of::<f32>()) as u64;
        self.tiles.extend(
            record
                .tiles
                .iter()
                .enumerate()
                .map(|(i, tile)| (*tile, at(i))),
        );
        self.items.push((item, place));
    }
}

/// What an earlier run left in the journal, checked against the plan.
struct Earlier<'a> {
    plans: &'a [LevelPlan],
    mode: Mode,
    levels: VecDeque<LevelState>,
    expected: Vec<Vec<Item>>,
}

impl<'a> Earlier<'a> {
    fn new(plans: &'a [LevelPlan], mode: Mode, spec: &NetSpec) -> Self {
        let expected = plans
            .iter()
            .enumerate()
            .map(|(i, p)| p.items(i as u32, mode, spec).collect())
            .collect();
        Self {
            plans,
            mode,
            levels: VecDeque::new(),
            expected,
        }
    }

    /// Takes the next record; `false` where it is not the one that the plan expects.
    fn accept(&mut self, kind: Kind, place: Place, content: &[u8]) -> bool {
        match kind {
            Kind::Start => false,
            Kind::Statistics => self.accept_statistics(content).is_some(),
            Kind::Item => self.accept_item(place, content).is_some(),
        }
    }

    /// The level that the next record belongs to.
    fn advance(&mut self) -> Option<usize> {
        let done = self
            .levels
            .back()
            .is_none_or(|state| state.items.len() == self.expected[self.levels.len() - 1].len());
        if done {
            if self.levels.len() == self.plans.len() {
                return None;
            }
            self.levels.push_back(LevelState::new());
        }
        Some(self.levels.len() - 1)
    }

    fn accept_statistics(&mut self, content: &[u8]) -> Option<()> {
        let level = self.advance()?;
        let (head, bytes) = content.split_first_chunk::<8>()?;
        let number = u32::from_le_bytes([head[0], head[1], head[2], head[3]]);
        let tiles = u32::from_le_bytes([head[4], head[5], head[6], head[7]]);
        let state = self.levels.back_mut()?;
        if number as usize != level || !state.items.is_empty() {
            return None;
        }
        state.statistics = Some((bytes.to_vec(), tiles));
        Some(())
    }

    fn accept_item(&mut self, place: Place, content: &[u8]) -> Option<()> {
        let level = self.advance()?;
        let record = Record::from_bytes(content)?;
        let state = self.levels.back_mut()?;
        let item = *self.expected[level].get(state.items.len())?;
        let count = (item.count[0] * item.count[1]) as usize;
        if record.level as usize != level || record.units.len() != count {
            return None;
        }
        if self.mode == Mode::Default {
            let plan = &self.plans[level];
            let len = record
                .sums
                .len()
                .checked_div(record.kept.len())
                .unwrap_or(0);
            let sum = |unit: usize| {
                let at = record.kept.iter().position(|&k| k as usize == unit)?;
                Some(record.sums[at * len..(at + 1) * len].to_vec())
            };
            let kept = (0..count)
                .filter(|&i| Frontier::is_kept(plan, &item, i))
                .map(|i| {
                    let head = record.units[i];
                    (
                        i,
                        CellSum {
                            vlad: sum(i),
                            usable_px: head.usable_px,
                            inside_px: head.inside_px,
                        },
                    )
                });
            state.frontier.restore(&item, kept.collect::<Vec<_>>());
        }
        state.tile_places += tile_places(self.mode, &item);
        let global_dim = record
            .globals
            .len()
            .checked_div(record.tiles.len())
            .unwrap_or(0);
        state.note(item, place, &record, global_dim);
        Some(())
    }
}

/// Tiles of the grid that an item completes.
fn tile_places(mode: Mode, item: &Item) -> u64 {
    let along = |a: usize| match mode {
        // The first row and column of cells complete no tile.
        Mode::Default => u64::from(item.count[a] - u32::from(item.first[a] == 0)),
        Mode::Paper => u64::from(item.count[a]),
    };
    along(0) * along(1)
}

/// The work on one level.
struct Work<'a> {
    raster: &'a dyn Raster,
    model: &'a Model,
    options: &'a BuildOptions,
    plan: LevelPlan,
    number: u32,
}

impl Work<'_> {
    fn run(
        self,
        mut state: LevelState,
        journal: &mut Journal,
        meter: &mut Meter,
        on_progress: &mut dyn FnMut(&Progress),
    ) -> Result<FinishedLevel> {
        let found = state.tiles.len() as u64;
        meter.resume(state.tile_places, state.tile_places - found);
        let items: Vec<Item> = self
            .plan
            .items(self.number, self.options.mode, self.model.spec())
            .collect();
        let keypoints_per_unit = keypoints_per_unit(self.model, self.options);
        if state.items.len() < items.len() {
            meter.progress.phase = if self.options.adapt {
                Phase::Adapting
            } else {
                Phase::Tiles
            };
            on_progress(&meter.progress);
            let extractor = self.extractor(&mut state, journal)?;
            meter.progress.phase = Phase::Tiles;
            let extract = ExtractOptions {
                threshold: self.options.keypoint_threshold,
                max_keypoints: keypoints_per_unit as usize,
                nms_radius_px: self.options.nms_radius_px,
            };
            let rest = items[state.items.len()..].to_vec();
            self.each_patch(rest, |item, patch| {
                let mode = self.options.mode;
                let units =
                    unit::compute_item(&extractor, &extract, &self.plan, &item, &patch, mode)?;
                drop(patch);
                let record = self.record(&mut state.frontier, &item, units);
                let place = journal.append(Kind::Item, &record.to_bytes())?;
                state.note(item, place, &record, self.model.spec().global_len());
                let places = tile_places(mode, &item);
                meter.advance(places, places - record.tiles.len() as u64);
                on_progress(&meter.progress);
                Ok(())
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
            let Some((statistics, tiles)) =
                adapt::adapted_statistics(self.raster, &own, &self.plan)?
            else {
                tracing::warn!(
                    level = self.number,
                    "no tile is good enough to adapt to; the model's statistics are used"
                );
                return Ok(own);
            };
            let bytes = statistics.to_bytes();
            let head = [self.number.to_le_bytes(), tiles.to_le_bytes()].concat();
            journal.append(Kind::Statistics, &[head, bytes.clone()].concat())?;
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

    /// Reads the pixels of each item, one ahead of `each`.
    fn each_patch(
        &self,
        items: Vec<Item>,
        mut each: impl FnMut(Item, RasterPatch) -> Result<()>,
    ) -> Result<()> {
        let (raster, plan, mode) = (self.raster, &self.plan, self.options.mode);
        let (sender, receiver) = mpsc::sync_channel(1);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for item in items {
                    let patch = unit::read_item(raster, plan, &item, mode);
                    // Nobody listens after an error.
                    if sender.send((item, patch)).is_err() {
                        return;
                    }
                }
            });
            // The receiver goes with this loop, also when `each` fails, so that the reader ends.
            for (item, patch) in receiver {
                each(item, patch?)?;
            }
            Ok(())
        })
    }

    fn record(&self, frontier: &mut Frontier, item: &Item, units: Vec<Unit>) -> Record {
        let mut record = Record {
            level: self.number,
            ..Record::default()
        };
        match self.options.mode {
            Mode::Default => {
                for (i, unit) in units.iter().enumerate() {
                    if let (true, Some(sum)) = (Frontier::is_kept(&self.plan, item, i), &unit.vlad)
                    {
                        record.kept.push(i as u32);
                        record.sums.extend_from_slice(sum);
                    }
                }
                let complete = frontier.complete(item, units.iter().map(Unit::cell_sum).collect());
                let (places, sums): (Vec<_>, Vec<_>) = complete
                    .into_iter()
                    .filter_map(|tile| Some((tile.place, VladSum::from_vec(tile.vlad?))))
                    .unzip();
                record.tiles = places;
                record.globals = self.model.global_descriptors(&sums);
            }
            Mode::Paper => {
                for (i, unit) in units.iter().enumerate() {
                    if let Some(global) = &unit.global {
                        record.tiles.push(TileEntry {
                            column: item.first[0] + i as u32,
                            row: item.first[1],
                        });
                        record.globals.extend_from_slice(global);
                    }
                }
            }
        }
        for unit in units {
            record.units.push(unit.head);
            record.blobs.extend_from_slice(&unit.blob);
        }
        record
    }
}
