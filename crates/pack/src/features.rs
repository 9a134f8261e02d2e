//! Keypoints and local descriptors as stored in the pack, and collected for one tile.

use half::f16;

use crate::format::{ALIGNMENT, BlobLayout, POSITION_STEPS_PER_PX};
use crate::local_descriptors::{DescriptorType, LocalDescriptors};

/// Features of one cell or paper tile, borrowed from the pack, strongest keypoint first.
#[derive(Clone, Copy, Debug)]
pub struct FeatureBlock<'a> {
    positions: &'a [[u16; 2]],
    scores: &'a [f16],
    /// Descriptors in their stored bytes.
    descriptors: &'a [u8],
    /// Bytes of one descriptor.
    descriptor_len: usize,
    /// Tile pixel of stored position (0, 0): x, y.
    offset_px: [f32; 2],
    /// Tile pixels per stored pixel (1 except in paper mode).
    px_per_stored_px: f32,
}

impl<'a> FeatureBlock<'a> {
    /// Views a blob whose descriptors have `descriptor_len` bytes. `None` if its parts do not fit.
    pub(crate) fn new(
        blob: &'a [u8],
        keypoints: usize,
        descriptor_len: usize,
        offset_px: [f32; 2],
        px_per_stored_px: f32,
    ) -> Option<Self> {
        let layout = BlobLayout::new(keypoints, descriptor_len)?;
        let positions = blob.get(layout.positions..layout.scores)?;
        let scores = blob.get(layout.scores..layout.end)?;
        Some(Self {
            positions: bytemuck::try_cast_slice(positions).ok()?,
            scores: bytemuck::try_cast_slice(scores).ok()?,
            descriptors: blob.get(..keypoints * descriptor_len)?,
            descriptor_len,
            offset_px,
            px_per_stored_px,
        })
    }

    /// Number of keypoints.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are no keypoints.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Position of keypoint `i` in the tile, level pixels, pixel centres at integers.
    pub fn xy_px(&self, i: usize) -> [f32; 2] {
        let stored = self.positions[i];
        std::array::from_fn(|a| {
            // Pixel centres are at integers, corners half a pixel away, in both scales.
            (f32::from(stored[a]) / POSITION_STEPS_PER_PX + 0.5) * self.px_per_stored_px - 0.5
                + self.offset_px[a]
        })
    }

    /// Probability of keypoint `i`.
    pub fn score(&self, i: usize) -> f32 {
        self.scores[i].to_f32()
    }

    /// The stored bytes of the descriptor of keypoint `i`.
    pub(crate) fn descriptor(&self, i: usize) -> &'a [u8] {
        &self.descriptors[i * self.descriptor_len..(i + 1) * self.descriptor_len]
    }
}

/// Features of one tile, collected from its cells.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TileFeatures {
    /// Positions in the tile, level pixels from its top-left pixel, pixel centres at integers.
    pub xy_px: Vec<[f32; 2]>,
    /// Keypoint probabilities, descending.
    pub scores: Vec<f32>,
    /// Descriptors, `n x descriptor_dim`.
    pub descriptors: LocalDescriptors,
    /// Numbers in a descriptor.
    pub descriptor_dim: usize,
}

impl TileFeatures {
    /// Number of keypoints.
    pub fn len(&self) -> usize {
        self.xy_px.len()
    }

    /// Whether there are no keypoints.
    pub fn is_empty(&self) -> bool {
        self.xy_px.is_empty()
    }

    /// The `most` strongest keypoints of some blocks; ties go to the earlier block, then the earlier keypoint.
    pub(crate) fn gather(
        blocks: &[FeatureBlock<'_>],
        dim: usize,
        (kind, scale): (DescriptorType, f32),
        most: usize,
    ) -> Self {
        let mut places: Vec<(u32, u32)> = Vec::new();
        let mut order: Vec<u64> = Vec::new();
        for (b, block) in blocks.iter().enumerate() {
            // Blocks are sorted, so no more than `most` of each can be among the strongest.
            for i in 0..block.len().min(most) {
                order.push(weakness(block.score(i), places.len() as u32));
                places.push((b as u32, i as u32));
            }
        }
        if most > 0 && most < order.len() {
            order.select_nth_unstable(most - 1);
        }
        order.truncate(most);
        order.sort_unstable();
        let mut all = Self {
            xy_px: Vec::with_capacity(order.len()),
            scores: Vec::with_capacity(order.len()),
            descriptors: LocalDescriptors::with_capacity(kind, scale, order.len() * dim),
            descriptor_dim: dim,
        };
        for key in order {
            let (b, i) = places[key as u32 as usize];
            let (block, i) = (&blocks[b as usize], i as usize);
            all.xy_px.push(block.xy_px(i));
            all.scores.push(block.score(i));
            all.descriptors.extend_from_bytes(block.descriptor(i));
        }
        all
    }
}

/// A key that rises as the score falls, and then with the place.
fn weakness(score: f32, place: u32) -> u64 {
    let bits = score.to_bits();
    // The order of `f32::total_cmp` as an unsigned number.
    let rising = if bits >> 31 == 0 {
        bits | 1 << 31
    } else {
        !bits
    };
    u64::from(!rising) << 32 | u64::from(place)
}

/// Writes keypoints (strongest first) as a blob.
///
/// `positions_px` count from the unit's top-left pixel, pixel centres at integers; `descriptors` are the stored bytes.
pub(crate) fn encode_blob(
    positions_px: &[[f32; 2]],
    scores: &[f32],
    descriptors: &[u8],
) -> Vec<u8> {
    let mut blob: Vec<u8> = descriptors.to_vec();
    blob.resize(blob.len().next_multiple_of(4), 0);
    for v in positions_px.iter().flatten() {
        let stored = (v * POSITION_STEPS_PER_PX).round().clamp(0.0, 65535.0) as u16;
        blob.extend_from_slice(&stored.to_le_bytes());
    }
    for &score in scores {
        blob.extend_from_slice(&f16::from_f32(score).to_le_bytes());
    }
    blob.resize(blob.len().next_multiple_of(ALIGNMENT as usize), 0);
    blob
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A blob at an address that is a multiple of 8, as in a mapped file.
    fn aligned(blob: &[u8]) -> Vec<u64> {
        let mut words = vec![0u64; blob.len().div_ceil(8)];
        bytemuck::cast_slice_mut::<u64, u8>(&mut words)[..blob.len()].copy_from_slice(blob);
        words
    }

    #[test]
    fn blob_round_trip() {
        let positions = [[3.0, 250.5], [255.0, 0.0], [17.25, 9.0]];
        let scores = [0.9, 0.5, 0.25];
        let descriptors: Vec<u8> = (0..3 * 6).collect();
        let words = aligned(&encode_blob(&positions, &scores, &descriptors));
        let block =
            FeatureBlock::new(bytemuck::cast_slice(&words), 3, 6, [256.0, 0.0], 1.0).unwrap();
        assert_eq!(block.len(), 3);
        assert_eq!(block.xy_px(0), [259.0, 250.5]);
        assert_eq!(block.xy_px(2), [273.25, 9.0]);
        assert_eq!(block.score(1), 0.5);
        assert_eq!(block.descriptor(1), &descriptors[6..12]);
        assert!(FeatureBlock::new(bytemuck::cast_slice(&words), 300, 6, [0.0; 2], 1.0).is_none());
    }

    #[test]
    fn paper_positions_are_scaled_about_the_corner() {
        // The corner between pixels -1 and 0 stays where it is, so pixel 0 of 320 has its centre at 0.8 - 0.5 of 512.
        let words = aligned(&encode_blob(&[[0.0, 319.0]], &[1.0], &[1, 2]));
        let block = FeatureBlock::new(bytemuck::cast_slice(&words), 1, 2, [0.0; 2], 1.6).unwrap();
        let [x, y] = block.xy_px(0);
        assert!((x - 0.3).abs() < 1e-5 && (y - (319.5 * 1.6 - 0.5)).abs() < 1e-4);
    }

    #[test]
    fn gather_takes_the_strongest_and_breaks_ties_by_order() {
        let a = aligned(&encode_blob(
            &[[0.0, 0.0], [1.0, 0.0]],
            &[0.5, 0.25],
            &[1, 2],
        ));
        let b = aligned(&encode_blob(
            &[[0.0, 0.0], [2.0, 0.0]],
            &[0.75, 0.5],
            &[3, 4],
        ));
        let blocks = [
            FeatureBlock::new(bytemuck::cast_slice(&a), 2, 1, [0.0; 2], 1.0).unwrap(),
            FeatureBlock::new(bytemuck::cast_slice(&b), 2, 1, [256.0, 0.0], 1.0).unwrap(),
        ];
        let all = TileFeatures::gather(&blocks, 1, (DescriptorType::Int8, 1.0), 3);
        assert_eq!(all.scores, [0.75, 0.5, 0.5]);
        assert_eq!(all.descriptors.to_f32(), [3.0, 1.0, 4.0]);
        assert_eq!(all.xy_px[2], [258.0, 0.0]);
    }
}
