//! From a finished journal to the pack: written aside, then renamed.

use std::path::Path;

use grimnet_kernels::{Isa, matmul_nt};
use grimnet_net::normalise;

use crate::build::journal::{Journal, Place};
use crate::build::plan::{Item, LevelPlan};
use crate::build::record::Record;
use crate::error::{PackError, Result};
use crate::format::{TileEntry, UnitEntry};
use crate::manifest::{IndexManifest, LevelManifest, Manifest};
use crate::options::{IndexChoice, Mode};
use crate::quantise::{descriptor_scale, quantise_row};
use crate::search::Hit;
use crate::search::ivf_pq::{IvfPqCodec, IvfPqLists};
use crate::search::top_k::TopK;
use crate::writer::Writer;

/// Numbers of tile descriptors handled at once: 64 MiB.
const BATCH_FLOATS: usize = 16 << 20;

/// Numbers of tile descriptors that an index is trained on, at most: 256 MiB.
const TRAINING_FLOATS: usize = 64 << 20;

/// Levels with more tiles get an IVF-PQ index in default mode: below, exact search takes milliseconds.
const EXACT_UP_TO_TILES: u64 = 100_000;

/// Lists visited, and candidates per answer ranked again, in default mode.
const DEFAULT_NPROBE: u32 = 32;
const DEFAULT_RERANK_FACTOR: u32 = 4;

/// Tiles whose neighbours are sought to measure an index.
const RECALL_QUERIES: usize = 256;
const RECALL_NEIGHBOURS: usize = 10;

/// Everything that is known about one level when its items are finished.
#[derive(Debug)]
pub struct FinishedLevel {
    pub plan: LevelPlan,
    /// Items and where their records lie, in order.
    pub items: Vec<(Item, Place)>,
    /// Tiles with a descriptor and where it lies in the journal; sorted here.
    pub tiles: Vec<(TileEntry, u64)>,
    pub keypoints_per_unit: u32,
    pub statistics: Option<(Vec<u8>, u32)>,
}

/// Writes the pack to `aside` and gives its manifest.
///
/// # Errors
/// Where a file cannot be read or written, or an index was asked for that cannot be trained.
pub fn write_pack(
    aside: &Path,
    journal: &mut Journal,
    levels: Vec<FinishedLevel>,
    mut manifest: Manifest,
) -> Result<Manifest> {
    let mut writer = Writer::create(aside)?;
    for (number, level) in levels.into_iter().enumerate() {
        let entry = write_level(&mut writer, journal, level, number, &manifest)?;
        manifest.levels.push(entry);
    }
    writer.finish(manifest)
}

fn write_level(
    writer: &mut Writer,
    journal: &mut Journal,
    mut level: FinishedLevel,
    number: usize,
    manifest: &Manifest,
) -> Result<LevelManifest> {
    level.tiles.sort_by_key(|(tile, _)| (tile.row, tile.column));
    let plan = &level.plan;
    let units = write_features(writer, journal, &level, number)?;
    writer.section(
        format!("{number}/units"),
        bytemuck::cast_slice(&units.entries),
    )?;
    let places: Vec<TileEntry> = level.tiles.iter().map(|(tile, _)| *tile).collect();
    writer.section(format!("{number}/tiles"), bytemuck::cast_slice(&places))?;

    let mut rows = Rows::open(journal, &level.tiles, manifest)?;
    let mut scales = Vec::with_capacity(places.len());
    writer.begin(format!("{number}/globals"))?;
    rows.for_each_batch(|_, batch, dim| {
        for row in batch.chunks_exact(dim) {
            let (bytes, scale) = quantise_row(row);
            writer.write(bytemuck::cast_slice(&bytes))?;
            scales.push(scale);
        }
        Ok(())
    })?;
    writer.section(
        format!("{number}/global_scales"),
        bytemuck::cast_slice(&scales),
    )?;
    let adapted_from_tiles = match &level.statistics {
        Some((bytes, tiles)) => {
            writer.section(format!("{number}/statistics"), bytes)?;
            *tiles
        }
        None => 0,
    };
    let index = write_index(writer, &mut rows, number, manifest)?;
    let tiles = places.len() as u64;
    let unit_places = u64::from(plan.unit_grid[0]) * u64::from(plan.unit_grid[1]);
    Ok(LevelManifest {
        frame: plan.frame,
        origin_px: plan.origin_px,
        tile_px: crate::level::TILE_PX,
        stride_px: crate::level::CELL_PX,
        network_px: plan.network_px,
        tile_grid: plan.tile_grid,
        unit_grid: plan.unit_grid,
        tiles,
        tiles_skipped: plan.tile_places() - tiles,
        units: units.computed,
        units_skipped: unit_places - units.computed,
        keypoints: units.keypoints,
        keypoints_per_unit: level.keypoints_per_unit,
        descriptor_scale: descriptor_scale(manifest.model.descriptor_dim),
        adapted_from_tiles,
        index,
    })
}

struct Units {
    entries: Vec<UnitEntry>,
    computed: u64,
    keypoints: u64,
}

fn write_features(
    writer: &mut Writer,
    journal: &mut Journal,
    level: &FinishedLevel,
    number: usize,
) -> Result<Units> {
    let grid = level.plan.unit_grid;
    let entries = vec![UnitEntry::default(); grid[0] as usize * grid[1] as usize];
    let mut units = Units {
        entries,
        computed: 0,
        keypoints: 0,
    };
    let mut bytes = Vec::new();
    writer.begin(format!("{number}/features"))?;
    for (item, place) in &level.items {
        journal.read(place.offset, place.len as usize, &mut bytes)?;
        let record = Record::from_bytes(&bytes)
            .ok_or_else(|| PackError::Options("the journal changed while it was read".into()))?;
        let mut blobs = record.blobs.as_slice();
        for (i, head) in record.units.iter().enumerate() {
            let (blob, rest) = blobs
                .split_at_checked(head.blob_len as usize)
                .unwrap_or((&[], &[]));
            blobs = rest;
            let at = [i as u32 % item.count[0], i as u32 / item.count[0]];
            let unit = (item.first[1] + at[1]) as usize * grid[0] as usize
                + (item.first[0] + at[0]) as usize;
            units.entries[unit] = UnitEntry {
                offset: writer.section_len(),
                keypoints: head.keypoints,
                state: head.state,
            };
            units.computed += u64::from(head.state);
            units.keypoints += u64::from(head.keypoints);
            writer.write(blob)?;
        }
    }
    Ok(units)
}

/// Tile descriptors of a level. In default mode each is without what all have in common, and of unit length again: the common
/// part tells no tile from another, and makes some tiles similar to every photo (hubs; Suzuki et al. 2013, "Centering similarity
/// measures to reduce hubs").
struct Rows<'a> {
    journal: &'a mut Journal,
    tiles: &'a [(TileEntry, u64)],
    dim: usize,
    /// The mean, a little shorter so that the descriptor of an only tile does not vanish; none in paper mode.
    common: Option<Vec<f32>>,
}

impl<'a> Rows<'a> {
    fn open(
        journal: &'a mut Journal,
        tiles: &'a [(TileEntry, u64)],
        manifest: &Manifest,
    ) -> Result<Self> {
        let mut rows = Self {
            journal,
            tiles,
            dim: manifest.model.global_dim,
            common: None,
        };
        if manifest.mode == Mode::Default {
            let mut sum = vec![0.0f64; rows.dim];
            rows.for_each_batch(|_, batch, dim| {
                for row in batch.chunks_exact(dim) {
                    sum.iter_mut()
                        .zip(row)
                        .for_each(|(s, x)| *s += f64::from(*x));
                }
                Ok(())
            })?;
            let count = tiles.len() as f64 + 1.0;
            rows.common = Some(sum.iter().map(|s| (s / count) as f32).collect());
        }
        Ok(rows)
    }

    fn read(&mut self, tile: usize, into: &mut Vec<f32>) -> Result<()> {
        let mut bytes = Vec::new();
        self.journal
            .read(self.tiles[tile].1, self.dim * size_of::<f32>(), &mut bytes)?;
        let first = into.len();
        into.extend(
            bytes
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        );
        if let Some(common) = &self.common {
            let row = &mut into[first..];
            row.iter_mut().zip(common).for_each(|(x, c)| *x -= c);
            normalise(row);
        }
        Ok(())
    }

    fn read_all(&mut self, tiles: impl IntoIterator<Item = usize>) -> Result<Vec<f32>> {
        let mut rows = Vec::new();
        tiles
            .into_iter()
            .try_for_each(|tile| self.read(tile, &mut rows))?;
        Ok(rows)
    }

    /// Hands all rows over, some at a time, with the index of the first and the dimension.
    fn for_each_batch(
        &mut self,
        mut each: impl FnMut(usize, &[f32], usize) -> Result<()>,
    ) -> Result<()> {
        let step = (BATCH_FLOATS / self.dim).max(1);
        for first in (0..self.tiles.len()).step_by(step) {
            let rows = self.read_all(first..self.tiles.len().min(first + step))?;
            each(first, &rows, self.dim)?;
        }
        Ok(())
    }
}

/// Writes the index that was chosen.
fn write_index(
    writer: &mut Writer,
    rows: &mut Rows<'_>,
    number: usize,
    manifest: &Manifest,
) -> Result<IndexManifest> {
    let tiles = rows.tiles.len();
    let exact = |note: &str| {
        Ok(IndexManifest::Exact {
            note: note.to_owned(),
        })
    };
    let (choice, insist) = match (manifest.options.index, manifest.mode) {
        (IndexChoice::Exact, _) => return exact(""),
        (IndexChoice::Auto, Mode::Default) => {
            if tiles as u64 <= EXACT_UP_TO_TILES {
                return exact("");
            }
            // About 4 sqrt(N) lists (faiss, "Guidelines to choose an index").
            let nlist = (4.0 * (tiles as f64).sqrt()) as u32;
            let subquantisers = if rows.dim.is_multiple_of(64) {
                64
            } else {
                rows.dim as u32
            };
            let (nprobe, rerank_factor) = (DEFAULT_NPROBE, DEFAULT_RERANK_FACTOR);
            (
                IndexChoice::IvfPq {
                    nlist,
                    subquantisers,
                    nprobe,
                    rerank_factor,
                },
                false,
            )
        }
        (IndexChoice::Auto, Mode::Paper) => (crate::options::PAPER_INDEX, false),
        (choice, _) => (choice, true),
    };
    let IndexChoice::IvfPq {
        nlist,
        subquantisers,
        nprobe,
        rerank_factor,
    } = choice
    else {
        return exact("");
    };
    let (lists, parts) = (nlist as usize, subquantisers as usize);
    match IvfPqCodec::check(tiles, rows.dim, lists, parts) {
        Err(error) if insist => return Err(error),
        Err(error) => return exact(&error.to_string()),
        Ok(()) => {}
    }
    let sample = IvfPqCodec::training_sample(tiles, lists);
    let most = (TRAINING_FLOATS / rows.dim).max(1);
    let training = rows.read_all(sample.iter().copied().step_by(sample.len().div_ceil(most)))?;
    let codec = IvfPqCodec::train(&training, rows.dim, lists, parts)?;
    drop(training);
    let (mut of_tile, mut codes) = (Vec::with_capacity(tiles), Vec::with_capacity(tiles * parts));
    rows.for_each_batch(|_, batch, _| {
        let (batch_lists, batch_codes) = codec.encode(batch);
        of_tile.extend(batch_lists);
        codes.extend(batch_codes);
        Ok(())
    })?;
    let inverted = codec.lists(&of_tile, &codes);
    let recall = measure_recall(
        rows,
        &codec,
        &inverted,
        nprobe as usize,
        rerank_factor as usize,
    )?;
    let mut section =
        |name: &str, bytes: &[u8]| writer.section(format!("{number}/ivf.{name}"), bytes);
    section("centroids", bytemuck::cast_slice(&codec.centroids))?;
    section("codebooks", bytemuck::cast_slice(&codec.codebooks))?;
    section("list_starts", bytemuck::cast_slice(&inverted.list_starts))?;
    section("ids", bytemuck::cast_slice(&inverted.ids))?;
    section("codes", &inverted.codes)?;
    Ok(IndexManifest::IvfPq {
        nlist,
        subquantisers,
        nprobe,
        rerank_factor,
        measured_recall_at_10: recall,
    })
}

/// Share of the exact nearest neighbours of some tiles (themselves left out) that the index finds.
fn measure_recall(
    rows: &mut Rows<'_>,
    codec: &IvfPqCodec,
    lists: &IvfPqLists,
    nprobe: usize,
    rerank_factor: usize,
) -> Result<f64> {
    let (tiles, dim) = (rows.tiles.len(), rows.dim);
    let count = tiles.min(RECALL_QUERIES);
    let sample: Vec<usize> = (0..count).map(|i| i * tiles / count).collect();
    let queries = rows.read_all(sample.iter().copied())?;
    let mut truth = vec![TopK::new(RECALL_NEIGHBOURS + 1); count];
    rows.for_each_batch(|first, batch, dim| {
        let n = batch.len() / dim;
        let mut products = vec![0.0; count * n];
        matmul_nt(Isa::detect(), count, n, dim, &queries, batch, &mut products);
        for (best, products) in truth.iter_mut().zip(products.chunks_exact(n)) {
            for (i, &similarity) in products.iter().enumerate() {
                best.push(Hit {
                    tile: first + i,
                    similarity,
                });
            }
        }
        Ok(())
    })?;
    let Some(view) = codec.view(lists) else {
        return Ok(0.0);
    };
    let wanted = (RECALL_NEIGHBOURS + 1) * rerank_factor.max(1);
    let found = view.search(&queries, wanted, nprobe, None);
    let (mut hits, mut possible) = (0, 0);
    for (i, (truth, mut found)) in truth.into_iter().zip(found).enumerate() {
        if rerank_factor > 0 {
            let query = &queries[i * dim..(i + 1) * dim];
            for hit in &mut found {
                let row = rows.read_all([hit.tile])?;
                hit.similarity = row.iter().zip(query).map(|(a, b)| a * b).sum();
            }
            found.sort_by(Hit::order);
        }
        let others = |hits: Vec<Hit>| {
            let tiles = hits
                .into_iter()
                .map(|h| h.tile)
                .filter(|&tile| tile != sample[i]);
            tiles.take(RECALL_NEIGHBOURS).collect::<Vec<_>>()
        };
        let (truth, found) = (others(truth.into_sorted()), others(found));
        possible += truth.len();
        hits += truth.iter().filter(|tile| found.contains(tile)).count();
    }
    Ok(hits as f64 / possible.max(1) as f64)
}
