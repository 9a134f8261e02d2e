//! Mutual nearest neighbours with Lowe's ratio test (Lowe 2004; the paper's section 3.5.2) through one matrix product.

use grimnet_kernels::{Isa, MatMut, MatRef, matmul_nt, matmul_nt_i8};
use grimnet_pack::LocalDescriptors;

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
    row_best: Vec<Option<(usize, S)>>,
    column_best: Vec<S>,
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
    /// Returns an error if the two sides differ in type, or a length is not a multiple of `dim`.
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
                self.f32.scores.resize(m * n, 0.0);
                if m > 0 && n > 0 {
                    matmul_nt(
                        self.isa,
                        MatRef::new(query, m, dim),
                        MatRef::new(tile, n, dim),
                        MatMut::new(&mut self.f32.scores, m, n),
                    );
                }
                Ok(Similarities(Tables::F32(Table {
                    buffers: &mut self.f32,
                    columns: n,
                    to_cosine: 1.0,
                    least: f32::NEG_INFINITY,
                })))
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
                self.i32.scores.resize(m * n, 0);
                if m > 0 && n > 0 {
                    matmul_nt_i8(
                        self.isa,
                        MatRef::new(query, m, dim),
                        MatRef::new(tile, n, dim),
                        MatMut::new(&mut self.i32.scores, m, n),
                    );
                }
                Ok(Similarities(Tables::I32(Table {
                    buffers: &mut self.i32,
                    columns: n,
                    to_cosine: from * to,
                    least: i32::MIN,
                })))
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
    /// matching (Hartley & Zisserman 2004, section 4.7.1). `near` appends the rows of the tile that a row of the query may be
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
    buffers: &'a mut Buffers<S>,
    columns: usize,
    to_cosine: f32,
    least: S,
}

/// A similarity before scaling.
trait Similarity: Copy + PartialOrd {
    fn as_f32(self) -> f32;
}

impl Similarity for f32 {
    fn as_f32(self) -> f32 {
        self
    }
}

impl Similarity for i32 {
    fn as_f32(self) -> f32 {
        self as f32
    }
}

impl<S: Similarity> Table<'_, S> {
    /// The inner loops have no branches so that the compiler vectorises them.
    fn mutual(&mut self, max_ratio: Option<f32>, matches: &mut Vec<Match>) {
        self.reset();
        let (least, to_cosine) = (self.least, self.to_cosine);
        let Buffers {
            scores,
            row_best,
            column_best,
            ..
        } = &mut *self.buffers;
        for row in scores.chunks_exact(self.columns.max(1)) {
            for (best, &score) in column_best.iter_mut().zip(row) {
                *best = if score > *best { score } else { *best };
            }
            let best = greatest(row, least);
            let column = row.iter().position(|&score| score == best);
            row_best.push(column.map(|column| (column, best)));
        }
        self.keep_mutual(matches, |row, column, _| {
            max_ratio.is_none_or(|most| passes_ratio(row, column, least, to_cosine, most))
        });
    }

    fn guided(
        &mut self,
        mut near: impl FnMut(usize, &mut Vec<usize>),
        max_closer: usize,
        matches: &mut Vec<Match>,
    ) {
        self.reset();
        let Buffers {
            scores,
            row_best,
            column_best,
            ..
        } = &mut *self.buffers;
        let mut allowed = Vec::new();
        for (index, row) in scores.chunks_exact(self.columns.max(1)).enumerate() {
            allowed.clear();
            near(index, &mut allowed);
            let mut best: Option<(usize, S)> = None;
            for &column in &allowed {
                let score = row[column];
                if best.is_none_or(|(_, best)| score > best) {
                    best = Some((column, score));
                }
                if score > column_best[column] {
                    column_best[column] = score;
                }
            }
            row_best.push(best);
        }
        self.keep_mutual(matches, |row, _, best| {
            row.iter().filter(|&&score| score > best).count() <= max_closer
        });
    }

    /// Clears the intermediate results.
    fn reset(&mut self) {
        let buffers = &mut *self.buffers;
        buffers.row_best.clear();
        buffers.column_best.clear();
        buffers.column_best.resize(self.columns, self.least);
        buffers.taken.clear();
        buffers.taken.resize(self.columns, false);
    }

    /// Keeps the best of each row if it is also the best of its column and `keep`, called with row, column and similarity, is true.
    fn keep_mutual(
        &mut self,
        matches: &mut Vec<Match>,
        mut keep: impl FnMut(&[S], usize, S) -> bool,
    ) {
        matches.clear();
        let Buffers {
            scores,
            row_best,
            column_best,
            taken,
        } = &mut *self.buffers;
        let rows = scores.chunks_exact(self.columns.max(1));
        for (index, (row, best)) in rows.zip(row_best).enumerate() {
            let Some((column, best)) = *best else {
                continue;
            };
            if column_best[column] != best || taken[column] || !keep(row, column, best) {
                continue;
            }
            taken[column] = true;
            matches.push(Match {
                query: index as u32,
                tile: column as u32,
                similarity: best.as_f32() * self.to_cosine,
            });
        }
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
        greatest(&row[..column], least),
        greatest(&row[column + 1..], least),
    );
    let second = if before > after { before } else { after };
    // Unit vectors: the squared distance is 2 - 2 cos. Rounding may take cos a little above one.
    let squared = |score: S| (2.0 - 2.0 * score.as_f32() * to_cosine).max(0.0);
    squared(row[column]) < max_ratio * max_ratio * squared(second)
}

fn greatest<S: Similarity>(row: &[S], least: S) -> S {
    const LANES: usize = 16;
    let mut lanes = [least; LANES];
    let chunks = row.chunks_exact(LANES);
    let rest = chunks.remainder();
    for chunk in chunks {
        for (lane, &score) in lanes.iter_mut().zip(chunk) {
            *lane = if score > *lane { score } else { *lane };
        }
    }
    lanes.iter().chain(rest).fold(
        least,
        |best, &score| if score > best { score } else { best },
    )
}
