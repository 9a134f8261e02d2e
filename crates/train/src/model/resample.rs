//! Changing the resolution of features and masks.

use burn::tensor::{Device, Tensor, TensorData};

/// Mask of the deepest features from the mask of 8 x 8 cells: a position counts if at least half of its 4 x 4 cells do, as in
/// `grimnet-net`.
///
/// # Shapes
/// `seen` `[n, h * w, 1]`, result `[n, (h / 4) * (w / 4), 1]`.
pub(super) fn coarse_mask(seen: &Tensor<3>, n: usize, h: usize, w: usize) -> Tensor<3> {
    let cells = seen.clone().reshape([n * (h / 4), 4, w / 4, 4]);
    let share = cells.mean_dim(3).mean_dim(1);
    let counts = share.greater_equal_elem(0.5).float();
    counts.reshape([n, (h / 4) * (w / 4), 1])
}

/// Bilinear weights that upsample `from` samples by two, with edges repeated (`align_corners = false`).
fn doubling(from: usize) -> Vec<f32> {
    let mut matrix = vec![0.0; 2 * from * from];
    for to in 0..2 * from {
        let at = (to as f32 + 0.5) / 2.0 - 0.5;
        let low = at.floor();
        let share = at - low;
        let clamp = |i: f32| (i.max(0.0) as usize).min(from - 1);
        matrix[to * from + clamp(low)] += 1.0 - share;
        matrix[to * from + clamp(low + 1.0)] += share;
    }
    matrix
}

/// Bilinear upsampling by two, `[n, h, w, c]` to `[n, 2h, 2w, c]`.
pub(super) fn upsample_twice(x: Tensor<4>) -> Tensor<4> {
    let [n, h, w, c] = x.dims();
    let device = x.device().without_autodiff();
    let constant = |side: usize, device: &Device| {
        let matrix =
            Tensor::<2>::from_data(TensorData::new(doubling(side), [2 * side, side]), device);
        matrix.autodiff_as(x.is_autodiff())
    };
    let tall = constant(h, &device)
        .unsqueeze::<3>()
        .expand([n, 2 * h, h])
        .matmul(x.clone().reshape([n, h, w * c]));
    // Columns: one product over [rows, w, c] with the row axis as batch.
    let rows = n * 2 * h;
    let wide = constant(w, &device)
        .unsqueeze::<3>()
        .expand([rows, 2 * w, w])
        .matmul(tall.reshape([rows, w, c]));
    wide.reshape([n, 2 * h, 2 * w, c])
}

trait AutodiffAs {
    /// The tensor as a constant of the autodiff graph, if there is one.
    fn autodiff_as(self, autodiff: bool) -> Self;
}

impl AutodiffAs for Tensor<2> {
    fn autodiff_as(self, autodiff: bool) -> Self {
        if autodiff { self.autodiff() } else { self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deep_position_counts_if_half_of_it_is_seen() {
        // Two pictures of 2 x 1 positions, with so many of their 16 cells seen.
        let counts = [16, 8, 7, 0];
        let device = Device::flex();
        let mut seen = vec![0.0f32; 4 * 16];
        for (position, count) in counts.into_iter().enumerate() {
            let (picture, column) = (position / 2, position % 2);
            for cell in 0..count {
                seen[picture * 32 + (cell / 4) * 8 + column * 4 + cell % 4] = 1.0;
            }
        }
        let seen = Tensor::from_data(TensorData::new(seen, [2, 32, 1]), &device);
        let mask = coarse_mask(&seen, 2, 4, 8).into_data_as::<f32>();
        assert_eq!(mask.try_to_vec::<f32>().unwrap(), [1.0, 1.0, 0.0, 0.0]);
    }
}
