//! Labels, masks and corresponding points of a batch, in the order of the network's output.

use crate::data::{Batch, LABEL_NONE, Pair, Scene};
use crate::loss::{Correspondences, constant};
use burn::tensor::Device;

/// Scenes of all views: map views first, then photos.
pub(super) fn scenes_of(batch: &Batch) -> Vec<Option<&Scene>> {
    let once = || batch.iter().map(|pair| pair.scene.as_ref());
    once().chain(once()).collect()
}

/// Keypoint labels of all cells: map views first, then photos.
pub(super) fn labels_of(batch: &Batch) -> Vec<u8> {
    let sat = batch.iter().flat_map(|pair| &pair.sat_labels);
    sat.chain(batch.iter().flat_map(|pair| &pair.uav_labels))
        .copied()
        .collect()
}

/// Whether each cell is inside the picture: map views first (always), then photos.
pub(super) fn seen_of(batch: &Batch) -> impl Iterator<Item = bool> {
    let sat = batch
        .iter()
        .flat_map(|pair| std::iter::repeat_n(true, pair.sat_labels.len()));
    sat.chain(batch.iter().flat_map(|pair| pair.uav_seen.iter().copied()))
}

/// Weight of each cell in the keypoint loss: 0 outside the picture, `dustbin` without a keypoint, else 1.
pub(super) fn cell_weights(batch: &Batch, labels: &[u8], dustbin: f32) -> Vec<f32> {
    let weight = |(label, seen): (&u8, bool)| match (seen, *label) {
        (false, _) => 0.0,
        (true, LABEL_NONE) => dustbin,
        (true, _) => 1.0,
    };
    labels.iter().zip(seen_of(batch)).map(weight).collect()
}

/// Corresponding points as (picture, x px, y px): those of the map views first, then those of the photos in the same order.
pub(super) fn points_of(batch: &Batch) -> Vec<(usize, [f32; 2])> {
    let n = batch.len();
    let of = |first: usize, points: fn(&Pair) -> &Vec<[f32; 2]>| {
        batch
            .iter()
            .enumerate()
            .flat_map(move |(i, pair)| points(pair).iter().map(move |at| (first + i, *at)))
    };
    of(0, |pair| &pair.sat_points)
        .chain(of(n, |pair| &pair.uav_points))
        .collect()
}

/// Points of a view nearer to each other than this count as the same place: half a descriptor cell.
const SAME_PLACE_PX: f32 = 4.0;

/// For each pair, each point of the map view and each point of the photo: whether they are the same place.
pub(super) fn same_places(batch: &Batch) -> Vec<bool> {
    let mut out = Vec::new();
    for pair in batch {
        for [x, y] in &pair.uav_points {
            let near = |[u, v]: &[f32; 2]| (u - x).hypot(v - y) < SAME_PLACE_PX;
            out.extend(pair.uav_points.iter().map(near));
        }
    }
    out
}

/// The points of all pairs as tensors.
pub(super) fn correspondences_of(batch: &Batch, device: &Device) -> Correspondences {
    let count = batch.first().map_or(0, |pair| pair.sat_points.len());
    let places = |points: fn(&Pair) -> &Vec<[f32; 2]>| {
        let values = batch.iter().flat_map(|pair| points(pair).as_flattened());
        constant(values.copied().collect(), [batch.len(), count, 2], device)
    };
    Correspondences {
        from_px: places(|pair| &pair.sat_points),
        to_px: places(|pair| &pair.uav_points),
        side_px: batch.first().map_or(0.0, |pair| pair.sat.width() as f32),
    }
}
