//! Exact cosine search: every tile descriptor against every query.

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt, matmul_nt_i8};
use rayon::prelude::*;

use super::top_k::{Hit, TopK};
use crate::global_rows::GlobalRows;
use crate::quantise::quantise_row;

/// Bytes of the rows that a task takes: half a level-2 cache.
const BYTES_PER_TASK: usize = 512 << 10;

/// Returns whether a tile may be found.
pub type Filter<'a> = &'a (dyn Fn(usize) -> bool + Sync);

/// Queries (`q x dim`) against rows (`n x dim`): the `k` best rows of each query. Rows for which the filter returns
/// `false` are left out.
///
/// If the rows are quantised, queries are quantised in the same way and compared by integer products, so the answer is
/// the same on every processor.
pub(crate) fn search(
    rows: GlobalRows<'_>,
    dim: usize,
    queries: &[f32],
    k: usize,
    filter: Option<Filter<'_>>,
) -> Vec<Vec<Hit>> {
    match rows {
        GlobalRows::Int8 { rows, scales } => search_i8(rows, scales, dim, queries, k, filter),
        GlobalRows::Float32(rows) => search_f32(rows, dim, queries, k, filter),
    }
}

fn search_f32(
    rows: &[f32],
    dim: usize,
    queries: &[f32],
    k: usize,
    filter: Option<Filter<'_>>,
) -> Vec<Vec<Hit>> {
    let query_count = queries.len() / dim;
    let isa = Isa::detect();
    let none = || vec![TopK::new(k); query_count];
    let rows_per_task = (BYTES_PER_TASK / (dim * size_of::<f32>())).max(1);
    let best = rows
        .par_chunks(rows_per_task * dim)
        .enumerate()
        .map(|(task, rows)| {
            let (first, count) = (task * rows_per_task, rows.len() / dim);
            let mut products = vec![0.0; query_count * count];
            matmul_nt(
                isa,
                MatRef::new(queries, query_count, dim),
                MatRef::new(rows, count, dim),
                MatMut::new(&mut products, query_count, count),
            );
            let mut best = none();
            for (best, products) in best.iter_mut().zip(products.chunks_exact(count.max(1))) {
                for (i, &similarity) in products.iter().enumerate() {
                    let tile = first + i;
                    if best.may_take(similarity) && filter.is_none_or(|keep| keep(tile)) {
                        best.push(Hit { tile, similarity });
                    }
                }
            }
            best
        })
        .reduce(none, merged);
    best.into_iter().map(TopK::into_sorted).collect()
}

/// The best of both, query by query.
fn merged(a: Vec<TopK>, b: Vec<TopK>) -> Vec<TopK> {
    a.into_iter().zip(b).map(|(a, b)| a.merge(b)).collect()
}

fn search_i8(
    rows: &[i8],
    scales: &[f32],
    dim: usize,
    queries: &[f32],
    k: usize,
    filter: Option<Filter<'_>>,
) -> Vec<Vec<Hit>> {
    let query_count = queries.len() / dim;
    let mut bytes = Vec::with_capacity(queries.len());
    let mut query_scales = Vec::with_capacity(query_count);
    for query in queries.chunks_exact(dim) {
        let (row, scale) = quantise_row(query);
        bytes.extend_from_slice(&row);
        query_scales.push(scale);
    }
    let isa = Isa::detect();
    let none = || vec![TopK::new(k); query_count];
    let rows_per_task = (BYTES_PER_TASK / dim).max(1);
    let best = rows
        .par_chunks(rows_per_task * dim)
        .enumerate()
        .map(|(task, rows)| {
            let (first, count) = (task * rows_per_task, rows.len() / dim);
            let mut products = vec![0i32; query_count * count];
            matmul_nt_i8(
                isa,
                MatRef::new(&bytes, query_count, dim),
                MatRef::new(rows, count, dim),
                MatMut::new(&mut products, query_count, count),
            );
            let mut best = none();
            for (q, products) in products.chunks_exact(count.max(1)).enumerate() {
                for (i, &product) in products.iter().enumerate() {
                    let tile = first + i;
                    let similarity = product as f32 * (scales[tile] * query_scales[q]);
                    if best[q].may_take(similarity) && filter.is_none_or(|keep| keep(tile)) {
                        best[q].push(Hit { tile, similarity });
                    }
                }
            }
            best
        })
        .reduce(none, merged);
    best.into_iter().map(TopK::into_sorted).collect()
}

/// Ranks given rows of one query by their full vectors.
pub(crate) fn rerank(
    rows: GlobalRows<'_>,
    query: &[f32],
    candidates: &[Hit],
    k: usize,
) -> Vec<Hit> {
    let dim = query.len();
    let (bytes, query_scale) = quantise_row(query);
    let mut best = TopK::new(k);
    for &Hit { tile, .. } in candidates {
        let place = tile * dim..(tile + 1) * dim;
        let similarity = match rows {
            GlobalRows::Int8 { rows, scales } => {
                let product: i32 = rows[place]
                    .iter()
                    .zip(&bytes)
                    .map(|(&a, &b)| i32::from(a) * i32::from(b))
                    .sum();
                product as f32 * (scales[tile] * query_scale)
            }
            GlobalRows::Float32(rows) => rows[place].iter().zip(query).map(|(a, b)| a * b).sum(),
        };
        best.push(Hit { tile, similarity });
    }
    best.into_sorted()
}
