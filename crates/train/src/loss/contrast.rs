//! Contrastive losses: dual softmax for local descriptors (as in DISK and XFeat), InfoNCE (van den Oord et al. 2018) within the
//! batch and against a memory of past batches (Wang et al. 2020) for global descriptors.

use super::{MASKED, constant};
use crate::model::vlad::unit_rows;
use burn::tensor::activation::log_softmax;
use burn::tensor::{Int, Tensor, TensorData};

/// Side of a descriptor cell, pixels.
const CELL_PX: f32 = grimnet_net::KEYPOINT_CELL_PX as f32;

/// Descriptors at points of pictures by bilinear interpolation between cell centres (the centre of cell i is pixel 8 i + 3.5),
/// scaled to unit length.
///
/// # Shapes
/// `descriptors` `[n, h, w, d]`; `points` are (picture, x px, y px); result `[points, d]`.
pub fn sample_descriptors(descriptors: Tensor<4>, points: &[(usize, [f32; 2])]) -> Tensor<2> {
    let [n, h, w, d] = descriptors.dims();
    let device = descriptors.device();
    let (mut index, mut share) = (
        Vec::with_capacity(points.len() * 4),
        Vec::with_capacity(points.len() * 4),
    );
    for &(picture, [x, y]) in points {
        let u = ((x - 3.5) / CELL_PX).clamp(0.0, (w - 1) as f32);
        let v = ((y - 3.5) / CELL_PX).clamp(0.0, (h - 1) as f32);
        let (left, top) = (
            (u as usize).min(w.saturating_sub(2)),
            (v as usize).min(h.saturating_sub(2)),
        );
        let (a, b) = (u - left as f32, v - top as f32);
        for (dy, wy) in [(0, 1.0 - b), (1, b)] {
            for (dx, wx) in [(0, 1.0 - a), (1, a)] {
                let (row, column) = ((top + dy).min(h - 1), (left + dx).min(w - 1));
                index.push(((picture * h + row) * w + column) as i32);
                share.push(wx * wy);
            }
        }
    }
    let count = points.len();
    let index = Tensor::<1, Int>::from_data(TensorData::new(index, [count * 4]), &device);
    let share = constant(share, [count, 4, 1], &device);
    let near = descriptors
        .reshape([n * h * w, d])
        .select(0, index)
        .reshape([count, 4, d]);
    unit_rows((near * share).sum_dim(1).reshape([count, d]))
}

/// Mean over the diagonal of -log softmax, along both axes; `[b, n, n]`.
fn dual_softmax(similarity: Tensor<3>) -> Tensor<1> {
    let [b, n, _] = similarity.dims();
    let device = similarity.device();
    let diagonal = Tensor::<2>::eye(n, &device).unsqueeze::<3>();
    let both = log_softmax(similarity.clone(), 2) + log_softmax(similarity, 1);
    (both * diagonal).sum().mul_scalar(-0.5 / (b * n) as f32)
}

/// Dual-softmax loss between corresponding descriptors of each pair.
///
/// # Shapes
/// `a` and `b` `[pairs * points, d]`, unit rows, corresponding row by row. A scalar.
pub fn descriptor_contrast(
    a: Tensor<2>,
    b: Tensor<2>,
    pairs: usize,
    temperature: f32,
) -> Tensor<1> {
    let [rows, d] = a.dims();
    let n = rows / pairs;
    let (a, b) = (a.reshape([pairs, n, d]), b.reshape([pairs, n, d]));
    dual_softmax(a.matmul(b.swap_dims(1, 2)).mul_scalar(1.0 / temperature))
}

/// InfoNCE between global descriptors of photos and maps: the map view of each photo against the other map views of the batch
/// and of the memory, and the photo of each map view against the other photos of the batch.
///
/// # Shapes
/// `sat`, `uav` `[n, d]`, `memory` `[m, d]` (no gradient), unit rows. `excluded` `[n * (n + m)]` is true where a column is not
/// a negative of a row (an overlapping place); the diagonal always counts. A scalar.
pub fn global_contrast(
    sat: Tensor<2>,
    uav: Tensor<2>,
    memory: Option<Tensor<2>>,
    excluded: &[bool],
    temperature: f32,
) -> Tensor<1> {
    let [n, _] = sat.dims();
    let device = sat.device();
    let columns = excluded.len() / n;
    let lowered = |width: usize| {
        let values = (0..n * width)
            .map(|i| {
                let (row, column) = (i / width, i % width);
                if row != column && excluded[row * columns + column] {
                    MASKED
                } else {
                    0.0
                }
            })
            .collect();
        constant(values, [n, width], &device)
    };
    let own = uav
        .clone()
        .matmul(sat.clone().transpose())
        .mul_scalar(1.0 / temperature);
    let wide = match memory {
        Some(memory) => {
            let past = uav.matmul(memory.transpose()).mul_scalar(1.0 / temperature);
            Tensor::cat(vec![own.clone(), past], 1)
        }
        None => own.clone(),
    };
    let width = wide.dims()[1];
    let diagonal = Tensor::<2>::eye(n, &device);
    let forth = log_softmax(wide + lowered(width), 1).narrow(1, 0, n) * diagonal.clone();
    let back = log_softmax(own.transpose() + lowered(n), 1) * diagonal;
    (forth + back).sum().mul_scalar(-0.5 / n as f32)
}
