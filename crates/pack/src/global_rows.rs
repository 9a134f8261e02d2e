//! Tile descriptors as a level stores them.

/// Tile descriptors of a level, one row each.
#[derive(Clone, Copy, Debug)]
pub(crate) enum GlobalRows<'a> {
    /// Quantised, one scale a row.
    Int8 { rows: &'a [i8], scales: &'a [f32] },
    /// In single precision.
    Float32(&'a [f32]),
}
