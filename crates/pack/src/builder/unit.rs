//! The features of one unit: a cell (default mode) or a tile (paper mode).

use grimnet_net::Keypoint;

use crate::builder::record::UnitHead;
use crate::builder::usable::is_enough;
use crate::features::encode_blob;
use crate::format::UnitState;
use crate::local_descriptors::DescriptorType;
use crate::quantise::quantise_descriptors;

/// Pixels of a unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UsablePx {
    /// Pixels with image content.
    pub usable: u64,
    /// Pixels inside the map.
    pub inside: u64,
}

impl UsablePx {
    /// Whether at least a share `min` of the pixels inside the map is usable.
    pub fn is_enough(&self, min: f64) -> bool {
        is_enough(self.usable, self.inside, min)
    }
}

/// What was computed for one unit.
#[derive(Clone, Debug, Default)]
pub struct Unit {
    /// Counts and state.
    pub head: UnitHead,
    /// Feature blob.
    pub blob: Vec<u8>,
    /// Default mode: the cell's VLAD sum.
    pub vlad: Option<Vec<f32>>,
    /// Paper mode: the tile's descriptor.
    pub global: Option<Vec<f32>>,
}

impl Unit {
    /// A unit without enough usable pixels.
    pub fn skipped(counts: UsablePx) -> Self {
        let head = UnitHead {
            state: UnitState::Skipped as u32,
            usable_px: counts.usable as u32,
            inside_px: counts.inside as u32,
            ..UnitHead::default()
        };
        Self {
            head,
            ..Self::default()
        }
    }

    /// A unit with these features; its top-left pixel is `origin_px` in the frame of the keypoints.
    pub fn computed(
        counts: UsablePx,
        keypoints: &[Keypoint],
        origin_px: [u32; 2],
        descriptors: &[f32],
        dim: usize,
        kind: DescriptorType,
    ) -> Self {
        let at = |k: &Keypoint| [k.x_px - origin_px[0] as f32, k.y_px - origin_px[1] as f32];
        let positions: Vec<[f32; 2]> = keypoints.iter().map(at).collect();
        let scores: Vec<f32> = keypoints.iter().map(|k| k.score).collect();
        let blob = match kind {
            DescriptorType::Int8 => {
                let quantised = quantise_descriptors(descriptors, dim);
                encode_blob(&positions, &scores, bytemuck::cast_slice(&quantised))
            }
            DescriptorType::Float32 => {
                encode_blob(&positions, &scores, bytemuck::cast_slice(descriptors))
            }
        };
        let head = UnitHead {
            state: UnitState::Computed as u32,
            keypoints: keypoints.len() as u32,
            usable_px: counts.usable as u32,
            inside_px: counts.inside as u32,
            blob_len: blob.len() as u64,
        };
        Self {
            head,
            blob,
            vlad: None,
            global: None,
        }
    }
}
