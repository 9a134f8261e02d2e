//! Mutual nearest neighbours with Lowe's ratio test (Lowe 2004; paper, eq. 18) through one matrix product.

use std::sync::{Mutex, PoisonError};

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt, matmul_nt_i8_by_rows};
use grimnet_pack::LocalDescriptors;

use crate::search::nearest::{Best, CountGreater, Merge, Nearest, Similarity};

/// A keypoint of the query and the keypoint of the tile that it was matched with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Row of the query's descriptors.
    pub query: u32,
    /// Row of the tile's descriptors.
    pub tile: u32,
    /// Cosine of the angle between the two descriptors.
    pub similarity: f32,
}

/// Sorts by falling similarity, as the progressive sampler expects; of equal ones the first row comes first.
pub fn sort_best_first(matches: &mut [Match]) {
    matches.sort_by(|a, b| {
        b.similarity
            .total_cmp(&a.similarity)
            .then(a.query.cmp(&b.query))
    });
}

/// Descriptors of one picture: one unit vector per row.
#[derive(Debug, Clone, Copy)]
pub enum Descriptors<'a> {
    /// As the network computes them, n x dim.
    F32(&'a [f32]),
    /// Quantised to int8, n x dim: value = integer * scale.
    I8 {
        /// The integers.
        values: &'a [i8],
        /// Quantisation scale.
        scale: f32,
    },
}

impl<'a> From<&'a LocalDescriptors> for Descriptors<'a> {
    fn from(stored: &'a LocalDescriptors) -> Self {
        match stored {
            LocalDescriptors::Int8 { values, scale } => Self::I8 {
                values,
                scale: *scale,
            },
            LocalDescriptors::Float32(values) => Self::F32(values),
        }
    }
}

/// Why descriptors cannot be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MatchingError {
    /// One side is quantised and the other is not.
    #[error("one set of descriptors is f32 and the other int8; both must have the same type")]
    Kinds,
    /// The length is not a multiple of the dimension.
    #[error("descriptor array of length {length}; expected a multiple of the dimension {dim}")]
    Length {
        /// Length of the array.
        length: usize,
        /// Dimension of a descriptor.
        dim: usize,
    },
    /// There is no memory for the similarities of all pairs.
    #[error("no memory for {rows} x {columns} similarities; match fewer descriptors at a time")]
    Memory {
        /// Descriptors of the query.
        rows: usize,
        /// Descriptors of the tile.
        columns: usize,
    },
}

/// Compares descriptors; keeps its buffers from one pair of pictures to the next.
#[derive(Debug)]
pub struct Matcher {
    isa: Isa,
    f32: Buffers<f32>,
    i32: Buffers<i32>,
}

/// Intermediate results of matching.
#[derive(Debug, Default)]
struct Buffers<S> {
    scores: Vec<S>,
    /// Among all pairs.
    nearest: Best<S>,
    /// Among the pairs that guided matching allows.
    allowed: Best<S>,
    taken: Vec<bool>,
}

/// The similarities of all pairs of descriptors of two pictures.
#[derive(Debug)]
pub struct Similarities<'a>(Tables<'a>);

#[derive(Debug)]
enum Tables<'a> {
    F32(Table<'a, f32>),
    I32(Table<'a, i32>),
}

impl Matcher {
    /// A matcher that uses this instruction set.
    pub fn new(isa: Isa) -> Self {
        Self {
            isa,
            f32: Buffers::default(),
            i32: Buffers::default(),
        }
    }

    /// Mutual nearest neighbours, see [`Similarities::mutual`].
    ///
    /// # Errors
    /// As [`Matcher::compare`].
    pub fn mutual(
        &mut self,
        query: Descriptors<'_>,
        tile: Descriptors<'_>,
        dim: usize,
        max_ratio: Option<f32>,
        matches: &mut Vec<Match>,
    ) -> Result<(), MatchingError> {
        self.compare(query, tile, dim)?.mutual(max_ratio, matches);
        Ok(())
    }

    /// Compares all unit descriptors of dimension `dim` of one picture with all of the other.
    ///
    /// # Errors
    /// Returns an error if the two sides differ in type, a length is not a multiple of `dim`, or there is no memory for the similarities.
    pub fn compare(
        &mut self,
        query: Descriptors<'_>,
        tile: Descriptors<'_>,
        dim: usize,
    ) -> Result<Similarities<'_>, MatchingError> {
        let rows = |length: usize| match length.checked_rem(dim) {
            Some(0) => Ok(length / dim),
            _ => Err(MatchingError::Length { length, dim }),
        };
        match (query, tile) {
            (Descriptors::F32(query), Descriptors::F32(tile)) => {
                let (m, n) = (rows(query.len())?, rows(tile.len())?);
                let mut table = Table {
                    isa: self.isa,
                    buffers: &mut self.f32,
                    columns: n,
                    to_cosine: 1.0,
                    least: f32::NEG_INFINITY,
                };
                table.multiply(m, |isa, scores, finished| {
                    let (query, tile) = (MatRef::new(query, m, dim), MatRef::new(tile, n, dim));
                    matmul_nt(isa, query, tile, MatMut::new(&mut *scores, m, n));
                    finished(0, scores);
                })?;
                Ok(Similarities(Tables::F32(table)))
            }
            (
                Descriptors::I8 {
                    values: query,
                    scale: from,
                },
                Descriptors::I8 {
                    values: tile,
                    scale: to,
                },
            ) => {
                let (m, n) = (rows(query.len())?, rows(tile.len())?);
                let mut table = Table {
                    isa: self.isa,
                    buffers: &mut self.i32,
                    columns: n,
                    to_cosine: from * to,
                    least: i32::MIN,
                };
                table.multiply(m, |isa, scores, finished| {
                    let (query, tile) = (MatRef::new(query, m, dim), MatRef::new(tile, n, dim));
                    matmul_nt_i8_by_rows(isa, query, tile, scores, finished);
                })?;
                Ok(Similarities(Tables::I32(table)))
            }
            _ => Err(MatchingError::Kinds),
        }
    }
}

impl Similarities<'_> {
    /// Writes mutual nearest neighbours to `matches`, ordered by row of the query.
    ///
    /// With `max_ratio`, a match is kept if its distance is below that many times the distance to the second nearest keypoint of
    /// the tile (Lowe 2004); it is also kept if the tile has one keypoint only. Of equal similarities the first row wins.
    pub fn mutual(&mut self, max_ratio: Option<f32>, matches: &mut Vec<Match>) {
        match &mut self.0 {
            Tables::F32(table) => table.mutual(max_ratio, matches),
            Tables::I32(table) => table.mutual(max_ratio, matches),
        }
    }

    /// Writes mutual nearest neighbours among the pairs that `near` allows to `matches`, ordered by row of the query: guided
    /// matching (Hartley & Zisserman 2004, algorithm 4.6). `near` appends the rows of the tile that a row of the query may be
    /// matched with. A match is kept if at most `max_closer` keypoints of the whole tile are more similar.
    pub fn guided(
        &mut self,
        near: impl FnMut(usize, &mut Vec<usize>),
        max_closer: usize,
        matches: &mut Vec<Match>,
    ) {
        match &mut self.0 {
            Tables::F32(table) => table.guided(near, max_closer, matches),
            Tables::I32(table) => table.guided(near, max_closer, matches),
        }
    }
}

/// Similarities of all pairs: one row per keypoint of the query.
#[derive(Debug)]
struct Table<'a, S> {
    isa: Isa,
    buffers: &'a mut Buffers<S>,
    columns: usize,
    to_cosine: f32,
    least: S,
}

impl<S: Similarity + Default + Send + Sync> Table<'_, S> {
    /// Computes the similarities of `rows` rows with `product`, which is given memory for them and a function that it calls with
    /// the first row and the similarities of each block of rows. The nearest neighbours are found block by block, while it is in
    /// the cache.
    ///
    /// # Errors
    /// [`MatchingError::Memory`], where a plain `resize` would end the process.
    fn multiply(
        &mut self,
        rows: usize,
        product: impl FnOnce(Isa, &mut [S], &(dyn Fn(usize, &[S]) + Sync)),
    ) -> Result<(), MatchingError> {
        let (isa, columns, least) = (self.isa, self.columns, self.least);
        let Buffers {
            scores, nearest, ..
        } = &mut *self.buffers;
        let lacks = MatchingError::Memory { rows, columns };
        let pairs = rows.checked_mul(columns).ok_or(lacks)?;
        let more = pairs.saturating_sub(scores.len());
        scores.try_reserve(more).map_err(|_| lacks)?;
        scores.resize(pairs, S::default());
        nearest.reset(rows, columns, least);
        if scores.is_empty() {
            return Ok(());
        }
        let nearest = Mutex::new(nearest);
        product(isa, scores, &|first, block| {
            let mut best = Best::default();
            best.reset(block.len() / columns, columns, least);
            isa.vectorise(Nearest {
                scores: block,
                least,
                best: &mut best,
            });
            let mut all = nearest.lock().unwrap_or_else(PoisonError::into_inner);
            isa.vectorise(Merge {
                all: &mut all,
                first,
                block: &best,
            });
        });
        Ok(())
    }

    fn mutual(&mut self, max_ratio: Option<f32>, matches: &mut Vec<Match>) {
        let (least, to_cosine) = (self.least, self.to_cosine);
        let Buffers {
            scores,
            nearest,
            taken,
            ..
        } = &mut *self.buffers;
        let keep = |row: &[S], column, _| {
            max_ratio.is_none_or(|most| passes_ratio(row, column, least, to_cosine, most))
        };
        keep_mutual(scores, nearest, taken, to_cosine, keep, matches);
    }

    fn guided(
        &mut self,
        mut near: impl FnMut(usize, &mut Vec<usize>),
        max_closer: usize,
        matches: &mut Vec<Match>,
    ) {
        let (isa, columns) = (self.isa, self.columns);
        let Buffers {
            scores,
            allowed: best,
            taken,
            ..
        } = &mut *self.buffers;
        let rows = scores.chunks_exact(columns.max(1));
        best.reset(rows.len(), columns, self.least);
        let mut allowed = Vec::new();
        for (index, row) in rows.enumerate() {
            allowed.clear();
            near(index, &mut allowed);
            let best_of_row = &mut best.of_row[index];
            for &column in &allowed {
                let score = row[column];
                if best_of_row.is_none_or(|(_, best)| score > best) {
                    *best_of_row = Some((column, score));
                }
                if score > best.of_column[column] {
                    best.of_column[column] = score;
                }
            }
        }
        let keep =
            |row: &[S], _, best| isa.vectorise(CountGreater(row, best)) as usize <= max_closer;
        keep_mutual(scores, best, taken, self.to_cosine, keep, matches);
    }
}

/// Keeps the best of each row if it is also the best of its column and `keep`, called with row, column and similarity, is true.
fn keep_mutual<S: Similarity>(
    scores: &[S],
    best: &Best<S>,
    taken: &mut Vec<bool>,
    to_cosine: f32,
    mut keep: impl FnMut(&[S], usize, S) -> bool,
    matches: &mut Vec<Match>,
) {
    matches.clear();
    taken.clear();
    taken.resize(best.of_column.len(), false);
    let rows = scores.chunks_exact(best.of_column.len().max(1));
    for (index, (row, of_row)) in rows.zip(&best.of_row).enumerate() {
        let Some((column, score)) = *of_row else {
            continue;
        };
        if best.of_column[column] != score || taken[column] || !keep(row, column, score) {
            continue;
        }
        taken[column] = true;
        matches.push(Match {
            query: index as u32,
            tile: column as u32,
            similarity: score.as_f32() * to_cosine,
        });
    }
}

fn passes_ratio<S: Similarity>(
    row: &[S],
    column: usize,
    least: S,
    to_cosine: f32,
    max_ratio: f32,
) -> bool {
    if row.len() < 2 {
        return true;
    }
    let (before, after) = (
        S::greatest(&row[..column], least),
        S::greatest(&row[column + 1..], least),
    );
    let second = if before > after { before } else { after };
    // Unit vectors: the squared distance is 2 - 2 cos. Rounding may take cos a little above one.
    let squared = |score: S| (2.0 - 2.0 * score.as_f32() * to_cosine).max(0.0);
    squared(row[column]) < max_ratio * max_ratio * squared(second)
}
