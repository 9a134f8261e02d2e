//! Local descriptors as a pack stores them: quantised, or as the network computed them.

use serde::{Deserialize, Serialize};

/// How a level stores descriptors, local ones and those of tiles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DescriptorType {
    /// Signed bytes with a quantisation scale, see [`crate::quantise`].
    #[default]
    Int8,
    /// Single precision, in packs of paper mode.
    Float32,
}

impl DescriptorType {
    /// Bytes of one number.
    pub fn number_len(self) -> usize {
        match self {
            Self::Int8 => size_of::<i8>(),
            Self::Float32 => size_of::<f32>(),
        }
    }

    /// Whether this is the type that manifests leave out.
    pub(crate) fn is_int8(&self) -> bool {
        *self == Self::Int8
    }
}

/// Local descriptors of some keypoints, `n x dim`.
#[derive(Clone, Debug, PartialEq)]
pub enum LocalDescriptors {
    /// Quantised: value = integer * scale, the same scale for all.
    Int8 {
        /// The integers.
        values: Vec<i8>,
        /// Quantisation scale.
        scale: f32,
    },
    /// Unit vectors.
    Float32(Vec<f32>),
}

impl Default for LocalDescriptors {
    fn default() -> Self {
        Self::Float32(Vec::new())
    }
}

impl LocalDescriptors {
    /// No descriptors, with room for `count` numbers.
    pub(crate) fn with_capacity(kind: DescriptorType, scale: f32, count: usize) -> Self {
        match kind {
            DescriptorType::Int8 => Self::Int8 {
                values: Vec::with_capacity(count),
                scale,
            },
            DescriptorType::Float32 => Self::Float32(Vec::with_capacity(count)),
        }
    }

    /// Appends the numbers of one or several descriptors in their stored bytes.
    pub(crate) fn extend_from_bytes(&mut self, bytes: &[u8]) {
        match self {
            Self::Int8 { values, .. } => values.extend_from_slice(bytemuck::cast_slice(bytes)),
            Self::Float32(values) => {
                let (numbers, _) = bytes.as_chunks::<4>();
                values.extend(numbers.iter().map(|b| f32::from_le_bytes(*b)));
            }
        }
    }

    /// The numbers in single precision.
    pub fn to_f32(&self) -> Vec<f32> {
        match self {
            Self::Int8 { values, scale } => values.iter().map(|&v| f32::from(v) * scale).collect(),
            Self::Float32(values) => values.clone(),
        }
    }
}
