//! Matrix products of strided views into slices.

/// A strided matrix in a slice: element `(i, j)` is `data[start + i * row_stride + j * column_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Index of element (0, 0).
    pub start: usize,
    /// Elements between one row and the next.
    pub row_stride: usize,
    /// Elements between one column and the next.
    pub column_stride: usize,
}

impl View {
    /// Rows of `row_stride` elements, one after the other, from `start`.
    pub fn rows(start: usize, row_stride: usize) -> Self {
        Self {
            start,
            row_stride,
            column_stride: 1,
        }
    }

    /// The transpose of [`View::rows`].
    pub fn columns(start: usize, column_stride: usize) -> Self {
        Self {
            start,
            row_stride: 1,
            column_stride,
        }
    }

    /// Whether all elements of `rows x columns`, neither of them 0, lie in a slice of this length.
    fn fits(&self, rows: usize, columns: usize, len: usize) -> bool {
        let down = (rows - 1).checked_mul(self.row_stride);
        let along = (columns - 1).checked_mul(self.column_stride);
        let last = down
            .zip(along)
            .and_then(|(down, along)| self.start.checked_add(down)?.checked_add(along));
        // What does not fit `usize` is outside of any slice.
        last.is_some_and(|last| last < len)
    }
}

/// `out = left * right`, or `out += left * right` with `accumulate`; sizes m x k and k x n, on the calling thread.
///
/// # Panics
/// Panics if a view reaches outside its slice, or rows of `out` overlap.
#[allow(clippy::too_many_arguments)]
pub fn product(
    [m, n, k]: [usize; 3],
    left: &[f32],
    left_view: View,
    right: &[f32],
    right_view: View,
    out: &mut [f32],
    out_view: View,
    accumulate: bool,
) {
    if m == 0 || n == 0 {
        return;
    }
    assert!(out_view.fits(m, n, out.len()), "result outside its slice");
    assert!(
        out_view.column_stride == 1 && out_view.row_stride >= n,
        "rows of the result overlap"
    );
    if k == 0 {
        // A sum of nothing.
        for row in (0..m).filter(|_| !accumulate) {
            out[out_view.start + row * out_view.row_stride..][..n].fill(0.0);
        }
        return;
    }
    assert!(
        left_view.fits(m, k, left.len()),
        "left matrix outside its slice"
    );
    assert!(
        right_view.fits(k, n, right.len()),
        "right matrix outside its slice"
    );
    // SAFETY: the assertions above keep every address inside the three slices, `out` is borrowed mutably so that it
    // overlaps neither input, and its elements are distinct.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr().add(out_view.start),
            1,
            out_view.row_stride as isize,
            accumulate,
            left.as_ptr().add(left_view.start),
            left_view.column_stride as isize,
            left_view.row_stride as isize,
            right.as_ptr().add(right_view.start),
            right_view.column_stride as isize,
            right_view.row_stride as isize,
            1.0,
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_plain_sum_on_strided_rows_and_transposes() {
        let left: Vec<f32> = (0..200)
            .map(|i| ((i * 37 % 19) as f32 - 9.0) / 7.0)
            .collect();
        let right: Vec<f32> = (0..200)
            .map(|i| ((i * 53 % 23) as f32 - 11.0) / 5.0)
            .collect();
        for (lv, rv) in [
            (View::rows(3, 4), View::rows(2, 7)),
            (View::columns(1, 9), View::rows(0, 8)),
            (View::rows(5, 11), View::columns(4, 10)),
        ] {
            let [m, n, k] = [9, 6, 12];
            let mut out = vec![1.0f32; 100];
            product(
                [m, n, k],
                &left,
                lv,
                &right,
                rv,
                &mut out,
                View::rows(2, 8),
                true,
            );
            for i in 0..m {
                for j in 0..n {
                    let plain: f32 = (0..k)
                        .map(|t| {
                            left[lv.start + i * lv.row_stride + t * lv.column_stride]
                                * right[rv.start + t * rv.row_stride + j * rv.column_stride]
                        })
                        .sum();
                    assert!((out[2 + i * 8 + j] - 1.0 - plain).abs() < 1e-4);
                }
            }
            assert_eq!(out[0], 1.0);
        }
    }

    #[test]
    fn views_outside_their_slices_are_refused_also_where_the_offset_overflows() {
        // Eight rows further the offset is 0 again.
        let wraps = 1 << (usize::BITS - 3);
        let refused = |left: View, right: View, out: View| {
            std::panic::catch_unwind(|| {
                let sizes = [9, 2, 2];
                product(
                    sizes,
                    &[1.0; 32],
                    left,
                    &[1.0; 4],
                    right,
                    &mut [0.0; 32],
                    out,
                    false,
                );
            })
            .is_err()
        };
        let good = View::rows(0, 2);
        assert!(!refused(good, good, good));
        for stride in [4, wraps] {
            let bad = View::rows(0, stride);
            assert!(
                refused(bad, good, good) && refused(good, good, bad),
                "{stride}"
            );
        }
        assert!(refused(good, View::rows(usize::MAX, 2), good));
    }

    #[test]
    fn a_product_of_no_depth_is_zero() {
        for (accumulate, expected) in [(false, [0.0, 0.0, 7.0]), (true, [7.0; 3])] {
            let mut out = [7.0; 3];
            let (empty, view) = (View::rows(0, 0), View::rows(0, 1));
            product([2, 1, 0], &[], empty, &[], view, &mut out, view, accumulate);
            assert_eq!(out, expected);
        }
    }
}
