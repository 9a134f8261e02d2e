//! One tensor of a model and how it is stored.

use half::f16;
use half::slice::HalfFloatSliceExt;
use half::vec::HalfFloatVecExt;
use serde::{Deserialize, Serialize};

/// Name of the PCA whitening projection, `[global_dim, K x D]`: the largest tensor of a model.
pub(crate) const WHITENING_PROJECTION: &str = "whitening.projection";
/// Name of the mean that is subtracted before the projection, `[K x D]`.
pub(crate) const WHITENING_MEAN: &str = "whitening.mean";

/// Largest magnitude of an int8 value: symmetric quantisation, -128 is not used.
const INT8_MAX: f32 = 127.0;

/// Number format in which a tensor is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DataType {
    /// Signed 8-bit integers with one `f32` scale per row (symmetric quantisation). Only the whitening projection may be
    /// stored this way.
    I8,
    /// IEEE 754 half precision: convolution weights, and the whitening projection unless it is int8.
    F16,
    /// IEEE 754 single precision: everything else.
    F32,
}

impl DataType {
    /// The default for a tensor: half precision for the large ones, single for the rest.
    pub(crate) fn of(name: &str, shape: &[usize]) -> Self {
        if shape.len() == 4 || name == WHITENING_PROJECTION {
            DataType::F16
        } else {
            DataType::F32
        }
    }

    /// The name in a safetensors header.
    pub(crate) fn name(self) -> &'static str {
        match self {
            DataType::I8 => "I8",
            DataType::F16 => "F16",
            DataType::F32 => "F32",
        }
    }
}

/// Values as stored.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Values {
    /// `value[row][i] = scales[row] * values[row][i]`.
    I8 {
        /// All rows, one after the other.
        values: Vec<i8>,
        /// One per row, not negative.
        scales: Vec<f32>,
    },
    F16(Vec<f16>),
    F32(Vec<f32>),
}

impl Values {
    /// Converts `values` (row-major, `rows` rows of equal length) to a data type.
    pub(crate) fn from_f32(values: Vec<f32>, rows: usize, data_type: DataType) -> Self {
        match data_type {
            DataType::I8 => quantise(&values, rows),
            DataType::F16 => Values::F16(Vec::from_f32_slice(&values)),
            DataType::F32 => Values::F32(values),
        }
    }

    /// The values, and for int8 the scales of the rows, in memory order.
    pub(crate) fn bytes(&self) -> (&[u8], Option<&[u8]>) {
        match self {
            Values::I8 { values, scales } => (
                bytemuck::cast_slice(values),
                Some(bytemuck::cast_slice(scales)),
            ),
            Values::F16(values) => (bytemuck::cast_slice(values), None),
            Values::F32(values) => (bytemuck::cast_slice(values), None),
        }
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Values::I8 { values, .. } => values.len(),
            Values::F16(values) => values.len(),
            Values::F32(values) => values.len(),
        }
    }

    /// Whether every value is a finite number.
    pub(crate) fn is_finite(&self) -> bool {
        match self {
            Values::I8 { scales, .. } => scales.iter().all(|v| v.is_finite() && *v >= 0.0),
            Values::F16(values) => values.iter().all(|v| v.is_finite()),
            Values::F32(values) => values.iter().all(|v| v.is_finite()),
        }
    }
}

/// Symmetric int8 quantisation with one scale per row: the row's largest magnitude becomes 127.
fn quantise(values: &[f32], rows: usize) -> Values {
    let columns = values.len() / rows.max(1);
    let mut scales = Vec::with_capacity(rows);
    let mut quantised = Vec::with_capacity(values.len());
    for row in values.chunks_exact(columns.max(1)) {
        let scale = row.iter().fold(0.0, |m: f32, v| m.max(v.abs())) / INT8_MAX;
        let steps = if scale > 0.0 { 1.0 / scale } else { 0.0 };
        // `as` saturates.
        quantised.extend(row.iter().map(|v| (v * steps).round_ties_even() as i8));
        scales.push(scale);
    }
    Values::I8 {
        values: quantised,
        scales,
    }
}

/// One tensor of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    pub(crate) shape: Vec<usize>,
    pub(crate) values: Values,
}

impl Parameter {
    /// The shape; row-major, last axis fastest.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// How it is stored.
    #[must_use]
    pub fn data_type(&self) -> DataType {
        match self.values {
            Values::I8 { .. } => DataType::I8,
            Values::F16(_) => DataType::F16,
            Values::F32(_) => DataType::F32,
        }
    }

    /// The values, row-major, converted to single precision.
    #[must_use]
    pub fn to_f32(&self) -> Vec<f32> {
        match &self.values {
            Values::I8 { values, scales } => {
                let columns = values.len() / scales.len().max(1);
                values
                    .chunks_exact(columns.max(1))
                    .zip(scales)
                    .flat_map(|(row, &scale)| row.iter().map(move |&v| f32::from(v) * scale))
                    .collect()
            }
            Values::F16(values) => values.to_f32_vec(),
            Values::F32(values) => values.clone(),
        }
    }

    /// The same tensor in another data type.
    pub(crate) fn converted(&self, data_type: DataType) -> Self {
        if self.data_type() == data_type {
            return self.clone();
        }
        let rows = self.shape.first().copied().unwrap_or(1);
        Self {
            shape: self.shape.clone(),
            values: Values::from_f32(self.to_f32(), rows, data_type),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn int8_values_are_off_by_half_a_step_at_most() {
        let values: Vec<f32> = (0..300)
            .map(|i| ((i * 37) % 101) as f32 * 0.013 - 0.7 * (i / 100) as f32)
            .chain([0.0; 100])
            .collect();
        let plain = Parameter {
            shape: vec![4, 100],
            values: Values::F32(values.clone()),
        };
        let int8 = plain.converted(DataType::I8);
        assert_eq!(int8.data_type(), DataType::I8);
        let Values::I8 { scales, .. } = &int8.values else {
            unreachable!()
        };
        for (i, (a, b)) in int8.to_f32().iter().zip(&values).enumerate() {
            let scale = scales[i / 100];
            assert!((a - b).abs() <= 0.5001 * scale, "{i}: {a} {b}");
        }
        assert_eq!(scales[3], 0.0);
        assert!(int8.values.is_finite());
        let half = int8.converted(DataType::F16);
        assert_eq!(half.data_type(), DataType::F16);
        assert_eq!(half.converted(DataType::F16), half);
    }

    #[test]
    fn scales_must_be_finite_and_not_negative() {
        for scale in [f32::NAN, f32::INFINITY, -1.0] {
            let values = Values::I8 {
                values: vec![1],
                scales: vec![scale],
            };
            assert!(!values.is_finite(), "{scale}");
        }
    }
}
