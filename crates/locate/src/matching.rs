//! Mutual nearest neighbours with Lowe's ratio test (Lowe 2004; the paper's section 3.5.2) through one matrix product.

use grimnet_kernels::{Isa, matmul_nt, matmul_nt_i8};

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

/// Descriptors of one picture, one unit vector a row.
#[derive(Debug, Clone, Copy)]
pub enum Descriptors<'a> {
    /// As the network gives them, n x dim.
    F32(&'a [f32]),
    /// Quantised, n x dim: value = integer * scale.
    I8 {
        /// The integers.
        values: &'a [i8],
        /// The step.
        scale: f32,
    },
}

/// Why descriptors cannot be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MatchingError {
    /// One side is quantised, the other is not.
    #[error(
        "descriptors of the photo and of the tile are stored differently: quantise both or neither"
    )]
    Kinds,
    /// A row would be cut short.
    #[error("{length} numbers are no whole number of descriptors of {dim}")]
    Length {
        /// Numbers given.
        length: usize,
        /// Numbers a descriptor has.
        dim: usize,
    },
}

/// Finds matches; keeps its buffers from one pair of pictures to the next.
#[derive(Debug)]
pub struct Matcher {
    isa: Isa,
    f32_scores: Vec<f32>,
    f32_best: Vec<f32>,
    i32_scores: Vec<i32>,
    i32_best: Vec<i32>,
    taken: Vec<bool>,
}

impl Matcher {
    /// A matcher on this instruction set.
    pub fn new(isa: Isa) -> Self {
        Self {
            isa,
            f32_scores: Vec::new(),
            f32_best: Vec::new(),
            i32_scores: Vec::new(),
            i32_best: Vec::new(),
            taken: Vec::new(),
        }
    }

    /// Mutual nearest neighbours of unit descriptors of `dim` numbers, by row of the query, into `matches`.
    ///
    /// With `max_ratio`, a match stays if its distance is below that many times the distance to the second nearest keypoint of
    /// the tile; a tile with one keypoint has no second, and the match stays. Of equal similarities the first row wins.
    ///
    /// # Errors
    /// Where the two sides are not of the same kind or length.
    pub fn mutual(
        &mut self,
        query: Descriptors<'_>,
        tile: Descriptors<'_>,
        dim: usize,
        max_ratio: Option<f32>,
        matches: &mut Vec<Match>,
    ) -> Result<(), MatchingError> {
        matches.clear();
        let rows = |length: usize| match length.checked_rem(dim) {
            Some(0) => Ok(length / dim),
            _ => Err(MatchingError::Length { length, dim }),
        };
        match (query, tile) {
            (Descriptors::F32(query), Descriptors::F32(tile)) => {
                let (m, n) = (rows(query.len())?, rows(tile.len())?);
                if m > 0 && n > 0 {
                    self.f32_scores.resize(m * n, 0.0);
                    matmul_nt(self.isa, m, n, dim, query, tile, &mut self.f32_scores);
                    let table = Table {
                        scores: &self.f32_scores,
                        columns: n,
                        to_cosine: 1.0,
                        max_ratio,
                    };
                    table.mutual(
                        f32::NEG_INFINITY,
                        &mut self.f32_best,
                        &mut self.taken,
                        matches,
                    );
                }
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
                if m > 0 && n > 0 {
                    self.i32_scores.resize(m * n, 0);
                    matmul_nt_i8(self.isa, m, n, dim, query, tile, &mut self.i32_scores);
                    let table = Table {
                        scores: &self.i32_scores,
                        columns: n,
                        to_cosine: from * to,
                        max_ratio,
                    };
                    table.mutual(i32::MIN, &mut self.i32_best, &mut self.taken, matches);
                }
            }
            _ => return Err(MatchingError::Kinds),
        }
        Ok(())
    }
}

/// Similarities of all pairs, one row a query keypoint.
struct Table<'a, S> {
    scores: &'a [S],
    columns: usize,
    to_cosine: f32,
    max_ratio: Option<f32>,
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
    /// Two passes without branches in the inner loop, so that the compiler makes vector code of them.
    fn mutual(
        &self,
        least: S,
        column_best: &mut Vec<S>,
        taken: &mut Vec<bool>,
        matches: &mut Vec<Match>,
    ) {
        column_best.clear();
        column_best.resize(self.columns, least);
        taken.clear();
        taken.resize(self.columns, false);
        for row in self.scores.chunks_exact(self.columns) {
            for (best, &score) in column_best.iter_mut().zip(row) {
                *best = if score > *best { score } else { *best };
            }
        }
        for (index, row) in self.scores.chunks_exact(self.columns).enumerate() {
            let best = greatest(row, least);
            let Some(column) = row.iter().position(|&score| score == best) else {
                continue;
            };
            if column_best[column] != best
                || taken[column]
                || !self.passes_ratio(row, column, best, least)
            {
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

    fn passes_ratio(&self, row: &[S], column: usize, best: S, least: S) -> bool {
        let Some(max_ratio) = self.max_ratio else {
            return true;
        };
        if self.columns < 2 {
            return true;
        }
        let (before, after) = (
            greatest(&row[..column], least),
            greatest(&row[column + 1..], least),
        );
        let second = if before > after { before } else { after };
        // Unit vectors: the squared distance is 2 - 2 cos. Rounding may take cos a little above one.
        let squared = |score: S| (2.0 - 2.0 * score.as_f32() * self.to_cosine).max(0.0);
        squared(best) < max_ratio * max_ratio * squared(second)
    }
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
