//! The loops of matching over all similarities, compiled for each instruction set.

use grimnet_kernels::PlainKernel;

/// Similarities that are looked at together, without a branch, so that the compiler vectorises the loops.
const LANES: usize = 16;

/// A similarity before scaling.
pub(super) trait Similarity: Copy + PartialOrd {
    fn as_f32(self) -> f32;

    /// The greatest similarity of a row; `least` if it is empty.
    fn greatest(row: &[Self], least: Self) -> Self;
}

impl Similarity for f32 {
    fn as_f32(self) -> f32 {
        self
    }

    #[inline(always)]
    fn greatest(row: &[f32], least: f32) -> f32 {
        let mut lanes = [least; LANES];
        let (blocks, rest) = row.as_chunks::<LANES>();
        for block in blocks {
            for (lane, &score) in lanes.iter_mut().zip(block) {
                *lane = if score > *lane { score } else { *lane };
            }
        }
        let mut best = least;
        for &score in lanes.iter().chain(rest) {
            best = if score > best { score } else { best };
        }
        best
    }
}

impl Similarity for i32 {
    fn as_f32(self) -> f32 {
        self as f32
    }

    /// The compiler may reorder integers, so that it vectorises the plain loop; lanes would become gathers.
    #[inline(always)]
    fn greatest(row: &[i32], least: i32) -> i32 {
        let mut best = least;
        for &score in row {
            best = best.max(score);
        }
        best
    }
}

/// The best similarity of each row, with its column, and of each column.
#[derive(Debug, Default)]
pub(super) struct Best<S> {
    pub of_row: Vec<Option<(usize, S)>>,
    pub of_column: Vec<S>,
}

impl<S: Similarity> Best<S> {
    /// Nothing found yet; no similarity is less than `least`.
    pub fn reset(&mut self, rows: usize, columns: usize, least: S) {
        self.of_row.clear();
        self.of_row.resize(rows, None);
        self.of_column.clear();
        self.of_column.resize(columns, least);
    }
}

/// Finds the best of each row, the first of equal ones, and of each column.
pub(super) struct Nearest<'a, S> {
    /// All rows.
    pub scores: &'a [S],
    /// No similarity is less.
    pub least: S,
    /// As it was reset.
    pub best: &'a mut Best<S>,
}

impl<S: Similarity> PlainKernel for Nearest<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Best { of_row, of_column } = self.best;
        let rows = self.scores.chunks_exact(of_column.len().max(1));
        for (row, found) in rows.zip(of_row) {
            for (best, &score) in of_column.iter_mut().zip(row) {
                *best = if score > *best { score } else { *best };
            }
            let best = S::greatest(row, self.least);
            *found = first_equal(row, best).map(|column| (column, best));
        }
    }
}

/// Adds the best of a block of rows to that of all rows.
pub(super) struct Merge<'a, S> {
    pub all: &'a mut Best<S>,
    /// The block's first row.
    pub first: usize,
    pub block: &'a Best<S>,
}

impl<S: Similarity> PlainKernel for Merge<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { all, first, block } = self;
        all.of_row[first..][..block.of_row.len()].copy_from_slice(&block.of_row);
        for (best, &score) in all.of_column.iter_mut().zip(&block.of_column) {
            *best = if score > *best { score } else { *best };
        }
    }
}

/// The number of similarities of a row that are greater than the given one.
pub(super) struct CountGreater<'a, S>(pub &'a [S], pub S);

impl<S: Similarity> PlainKernel for CountGreater<'_, S> {
    type Output = u32;

    #[inline(always)]
    fn run(self) -> u32 {
        let Self(row, limit) = self;
        let mut count = 0;
        for &score in row {
            count += u32::from(score > limit);
        }
        count
    }
}

/// The first column that holds `value`.
#[inline(always)]
fn first_equal<S: Similarity>(row: &[S], value: S) -> Option<usize> {
    let (blocks, _) = row.as_chunks::<LANES>();
    let mut first = 0;
    for block in blocks {
        let mut is_there = false;
        for &score in block {
            is_there |= score == value;
        }
        if is_there {
            break;
        }
        first += LANES;
    }
    let column = row[first..].iter().position(|&score| score == value)?;
    Some(first + column)
}

#[cfg(test)]
mod tests {
    use grimnet_kernels::Isa;

    use super::*;

    #[test]
    fn every_instruction_set_finds_the_first_of_the_best() {
        // 37 columns: two blocks and a rest. Values repeat, so that the best of a row occurs several times.
        let columns = 37;
        let scores: Vec<i32> = (0..9 * columns)
            .map(|i| (i * 7919 % 23) as i32 - 11)
            .collect();
        for isa in Isa::available() {
            let mut all = Best::default();
            all.reset(9, columns, i32::MIN);
            for first in [6, 0, 3] {
                let mut best = Best::default();
                best.reset(3, columns, i32::MIN);
                isa.vectorise(Nearest {
                    scores: &scores[first * columns..][..3 * columns],
                    least: i32::MIN,
                    best: &mut best,
                });
                isa.vectorise(Merge {
                    all: &mut all,
                    first,
                    block: &best,
                });
            }
            for (row, found) in scores.chunks_exact(columns).zip(&all.of_row) {
                let best = *row.iter().max().unwrap();
                let column = row.iter().position(|&score| score == best).unwrap();
                assert_eq!(*found, Some((column, best)), "{isa}");
                let closer = row.iter().filter(|&&score| score > 3).count();
                assert_eq!(
                    isa.vectorise(CountGreater(row, 3)) as usize,
                    closer,
                    "{isa}"
                );
            }
            for (column, best) in all.of_column.iter().enumerate() {
                let of_column = scores.iter().skip(column).step_by(columns);
                assert_eq!(Some(best), of_column.max(), "{isa}");
            }
        }
    }

    #[test]
    fn a_row_that_is_not_comparable_has_no_best() {
        let mut best = Best::default();
        best.reset(1, 3, f32::NEG_INFINITY);
        Isa::Portable.vectorise(Nearest {
            scores: &[f32::NAN; 3],
            least: f32::NEG_INFINITY,
            best: &mut best,
        });
        assert_eq!(best.of_row, [None]);
    }
}
