//! Trains and writes the search index of a level.

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt};

use crate::builder::recipe::Recipe;
use crate::builder::tile_descriptors::TileDescriptors;
use crate::error::Result;
use crate::index::Index;
use crate::search::ivf_pq::{CODEWORDS, FEW_POINTS_PER_CENTROID, IvfPqCodec, IvfPqLists};
use crate::search::top_k::{Hit, TopK};
use crate::writer::Writer;

/// Maximum numbers of tile descriptors that an index is trained on: 256 MiB.
const TRAINING_FLOATS: usize = 64 << 20;

/// Tiles whose neighbours are searched to measure an index, and how many neighbours.
const RECALL_QUERIES: usize = 256;
const RECALL_NEIGHBOURS: usize = 10;

/// The index of a level, with the fields of [`crate::manifest::LevelManifest`].
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltIndex {
    pub index: Index,
    pub note: String,
    pub recall_at_10: Option<f64>,
}

impl BuiltIndex {
    fn exact(note: String) -> Self {
        Self {
            index: Index::Exact,
            note,
            recall_at_10: None,
        }
    }
}

/// Writes the index that the options choose, or else the default one.
///
/// # Errors
/// Returns an error if a file cannot be read or written, or if a chosen index cannot be trained. A default index that
/// cannot be trained is replaced by exact search, and the reason noted.
pub fn write_index(
    writer: &mut Writer,
    descriptors: &mut TileDescriptors<'_>,
    number: usize,
    chosen: Option<Index>,
    recipe: &dyn Recipe,
) -> Result<BuiltIndex> {
    let (tiles, dim) = (descriptors.len(), descriptors.dim());
    let index = chosen.unwrap_or_else(|| recipe.default_index(tiles, dim));
    let Index::IvfPq {
        nlist,
        subquantisers,
        nprobe,
        rerank_factor,
    } = index
    else {
        return Ok(BuiltIndex::exact(String::new()));
    };
    let (lists, parts) = (nlist as usize, subquantisers as usize);
    match IvfPqCodec::check(tiles, dim, lists, parts) {
        Err(error) if chosen.is_some() => return Err(error),
        Err(error) => return Ok(BuiltIndex::exact(error.to_string())),
        Ok(()) => {}
    }
    let recommended = recommended_tiles(lists);
    if tiles < recommended {
        tracing::warn!(
            tiles,
            recommended,
            "few tiles to train an IVF-PQ index on; expect low recall"
        );
    }
    let sample = IvfPqCodec::training_sample(tiles, lists);
    let most = (TRAINING_FLOATS / dim).max(1);
    let sample = sample.iter().copied().step_by(sample.len().div_ceil(most));
    let training = descriptors.read_all(sample)?;
    let codec = IvfPqCodec::train(&training, dim, lists, parts)?;
    drop(training);
    let (mut of_tile, mut codes) = (Vec::with_capacity(tiles), Vec::with_capacity(tiles * parts));
    descriptors.for_each_batch(|_, batch| {
        let (batch_lists, batch_codes) = codec.encode(batch);
        of_tile.extend(batch_lists);
        codes.extend(batch_codes);
        Ok(())
    })?;
    let inverted = codec.lists(&of_tile, &codes);
    let recall = measure_recall(
        descriptors,
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
    Ok(BuiltIndex {
        index,
        note: String::new(),
        recall_at_10: Some(recall),
    })
}

/// Fewest tiles for which so many lists find most neighbours. Of a large map a sample is enough for training.
fn recommended_tiles(lists: usize) -> usize {
    FEW_POINTS_PER_CENTROID * lists.max(CODEWORDS)
}

/// Share of the exact nearest neighbours of sampled tiles (themselves left out) that the index finds.
fn measure_recall(
    descriptors: &mut TileDescriptors<'_>,
    codec: &IvfPqCodec,
    lists: &IvfPqLists,
    nprobe: usize,
    rerank_factor: usize,
) -> Result<f64> {
    let (tiles, dim) = (descriptors.len(), descriptors.dim());
    let count = tiles.min(RECALL_QUERIES);
    let sample: Vec<usize> = (0..count).map(|i| i * tiles / count).collect();
    let queries = descriptors.read_all(sample.iter().copied())?;
    let mut truth = vec![TopK::new(RECALL_NEIGHBOURS + 1); count];
    descriptors.for_each_batch(|first, batch| {
        let n = batch.len() / dim;
        let mut products = vec![0.0; count * n];
        matmul_nt(
            Isa::detect(),
            MatRef::new(&queries, count, dim),
            MatRef::new(batch, n, dim),
            MatMut::new(&mut products, count, n),
        );
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
                let row = descriptors.read_all([hit.tile])?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builder::cells::Cells;
    use crate::paper::PAPER_INDEX;

    #[test]
    fn no_map_is_too_small_for_its_default_index() {
        for tiles in [100_001, 180_000, 1_000_000, 8_000_000] {
            let Index::IvfPq { nlist, .. } = Cells.default_index(tiles, 1024) else {
                panic!("exact search of {tiles} tiles");
            };
            assert!(tiles >= recommended_tiles(nlist as usize), "{tiles}");
            // Although the sample that it is trained on has fewer.
            let sample = IvfPqCodec::training_sample(tiles, nlist as usize);
            assert!(sample.len() <= 1 << 16);
        }
        let Index::IvfPq { nlist, .. } = PAPER_INDEX else {
            unreachable!()
        };
        assert_eq!(recommended_tiles(nlist as usize), 9984);
    }
}
