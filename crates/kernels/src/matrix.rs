//! Views of row-major matrices.

/// A read-only view of a row-major matrix.
#[derive(Debug, Clone, Copy)]
pub struct MatRef<'a, T> {
    data: &'a [T],
    rows: usize,
    cols: usize,
    row_stride: usize,
}

/// A writable view of a row-major matrix.
#[derive(Debug)]
pub struct MatMut<'a, T> {
    data: &'a mut [T],
    rows: usize,
    cols: usize,
    row_stride: usize,
}

/// Elements from the first of the first row to the last of the last row.
///
/// # Panics
/// If rows overlap, or the number does not fit `usize`.
#[track_caller]
fn span(rows: usize, cols: usize, row_stride: usize) -> usize {
    assert!(
        row_stride >= cols,
        "row stride {row_stride} of a matrix with {cols} columns: rows must not overlap"
    );
    let before_last = rows.saturating_sub(1).checked_mul(row_stride);
    let span = before_last.and_then(|len| len.checked_add(if rows == 0 { 0 } else { cols }));
    match span {
        Some(span) => span,
        None => panic!("a matrix of {rows} x {cols} elements does not fit the address space"),
    }
}

impl<'a, T> MatRef<'a, T> {
    /// A matrix of `rows` x `cols` elements without gaps.
    ///
    /// # Panics
    /// If `data` does not have exactly `rows * cols` elements.
    #[must_use]
    #[track_caller]
    pub fn new(data: &'a [T], rows: usize, cols: usize) -> Self {
        assert_eq!(
            data.len(),
            span(rows, cols, cols),
            "elements of a {rows} x {cols} matrix"
        );
        Self {
            data,
            rows,
            cols,
            row_stride: cols,
        }
    }

    /// A matrix whose rows begin `row_stride` elements apart.
    ///
    /// # Panics
    /// If `row_stride` is less than `cols`, or `data` ends before the last row does.
    #[must_use]
    #[track_caller]
    pub fn with_row_stride(data: &'a [T], rows: usize, cols: usize, row_stride: usize) -> Self {
        assert!(
            data.len() >= span(rows, cols, row_stride),
            "{} elements are too few for a {rows} x {cols} matrix of row stride {row_stride}",
            data.len()
        );
        Self {
            data,
            rows,
            cols,
            row_stride,
        }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[must_use]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Elements from the beginning of one row to that of the next.
    pub(crate) fn row_stride(&self) -> usize {
        self.row_stride
    }

    /// The elements of a row.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    #[inline(always)]
    pub fn row(&self, row: usize) -> &'a [T] {
        assert!(row < self.rows, "row of a matrix");
        &self.data[row * self.row_stride..][..self.cols]
    }

    /// The address of a row, valid to the end of the matrix.
    ///
    /// # Panics
    /// If the row begins beyond the end.
    pub(crate) fn row_ptr(&self, row: usize) -> *const T {
        self.data[row * self.row_stride..].as_ptr()
    }
}

impl<'a, T> MatMut<'a, T> {
    /// A matrix of `rows` x `cols` elements without gaps.
    ///
    /// # Panics
    /// If `data` does not have exactly `rows * cols` elements.
    #[must_use]
    #[track_caller]
    pub fn new(data: &'a mut [T], rows: usize, cols: usize) -> Self {
        let MatRef { row_stride, .. } = MatRef::new(data, rows, cols);
        Self {
            data,
            rows,
            cols,
            row_stride,
        }
    }

    /// A matrix whose rows begin `row_stride` elements apart. What lies between the rows is not touched.
    ///
    /// # Panics
    /// If `row_stride` is less than `cols`, or `data` ends before the last row does.
    #[must_use]
    #[track_caller]
    pub fn with_row_stride(data: &'a mut [T], rows: usize, cols: usize, row_stride: usize) -> Self {
        let MatRef { .. } = MatRef::with_row_stride(data, rows, cols, row_stride);
        Self {
            data,
            rows,
            cols,
            row_stride,
        }
    }

    /// Number of rows.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    #[must_use]
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Elements from the beginning of one row to that of the next.
    pub(crate) fn row_stride(&self) -> usize {
        self.row_stride
    }

    /// The elements of a row.
    ///
    /// # Panics
    /// If there is no such row.
    #[must_use]
    pub fn row_mut(&mut self, row: usize) -> &mut [T] {
        assert!(row < self.rows, "row of a matrix");
        &mut self.data[row * self.row_stride..][..self.cols]
    }

    /// All elements, and what lies between the rows.
    pub(crate) fn data_mut(&mut self) -> &mut [T] {
        self.data
    }

    /// Sets every element.
    pub(crate) fn fill(&mut self, value: T)
    where
        T: Copy,
    {
        (0..self.rows).for_each(|row| self.row_mut(row).fill(value));
    }
}

/// Checks that an `m x k` by `k x n` product has `m x n` elements; `b` is given as `[k, n]`.
///
/// # Panics
/// If it has not.
#[track_caller]
pub(crate) fn check_shapes(a: [usize; 2], b: [usize; 2], c: [usize; 2]) {
    assert!(
        a[1] == b[0] && c == [a[0], b[1]],
        "shapes of a matrix product: {}x{} by {}x{} into {}x{}",
        a[0],
        a[1],
        b[0],
        b[1],
        c[0],
        c[1]
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_found_by_their_stride() {
        let data: Vec<u8> = (0..11).collect();
        let matrix = MatRef::with_row_stride(&data, 3, 3, 4);
        assert_eq!(matrix.row(2), [8, 9, 10]);
        let mut data = data.clone();
        let mut matrix = MatMut::with_row_stride(&mut data, 3, 2, 4);
        matrix.fill(77);
        assert_eq!(data, [77, 77, 2, 3, 77, 77, 6, 7, 77, 77, 10]);
        assert_eq!(MatRef::<u8>::new(&[], 0, 5).rows(), 0);
        assert_eq!(MatRef::<u8>::new(&[], 5, 0).row(4), [0u8; 0]);
    }

    #[test]
    fn shapes_that_do_not_fit_the_data_are_refused() {
        let refused = |make: fn(&[u8])| std::panic::catch_unwind(|| make(&[0; 10])).is_err();
        let strided = |rows, cols, stride| {
            std::panic::catch_unwind(|| {
                let _ = MatRef::with_row_stride(&[0u8; 10], rows, cols, stride);
            })
            .is_err()
        };
        assert!(refused(|data| {
            let _ = MatRef::new(data, 3, 3);
        }));
        assert!(!strided(3, 2, 4) && strided(3, 3, 4));
        assert!(strided(2, 5, 4), "rows overlap");
        assert!(strided(usize::MAX, 2, 4));
    }
}
