//! Moments of channels, and the affine map that normalisation comes down to.

use rayon::prelude::*;

use crate::{Activation, Isa, Tensor};

/// Mean and biased variance of every channel over the pixels whose `mask` (`height x width`) is not zero, or over all.
///
/// Sums are in `f64`, row by row, so the result does not depend on the number of threads. Without a single pixel the
/// mean is 0 and the variance 1, which normalises to the identity.
///
/// # Panics
/// If the mask has not `height x width` elements.
#[must_use]
pub fn channel_moments(tensor: &Tensor, mask: Option<&[u8]>) -> (Vec<f32>, Vec<f32>) {
    let (h, w, channels) = (tensor.height(), tensor.width(), tensor.channels());
    if let Some(mask) = mask {
        assert_eq!(mask.len(), h * w, "elements of the mask of {tensor:?}");
    }
    let seen = |y: usize, x: usize| mask.is_none_or(|mask| mask[y * w + x] != 0);
    // Two passes: the variance around the mean loses no digits.
    let sum_rows = |value: &(dyn Fn(usize, f32) -> f64 + Sync)| -> Vec<f64> {
        let rows: Vec<Vec<f64>> = (0..h)
            .into_par_iter()
            .map(|y| {
                let mut sums = vec![0.0; channels];
                for x in (0..w).filter(|&x| seen(y, x)) {
                    for (c, (sum, &v)) in sums.iter_mut().zip(tensor.pixel(y, x)).enumerate() {
                        *sum += value(c, v);
                    }
                }
                sums
            })
            .collect();
        let mut total = vec![0.0; channels];
        for row in rows {
            total.iter_mut().zip(row).for_each(|(t, r)| *t += r);
        }
        total
    };
    let count = (0..h * w).filter(|i| seen(i / w, i % w)).count();
    if count == 0 {
        return (vec![0.0; channels], vec![1.0; channels]);
    }
    let mean: Vec<f64> = sum_rows(&|_, v| f64::from(v))
        .into_iter()
        .map(|s| s / count as f64)
        .collect();
    let squares = sum_rows(&|c, v| (f64::from(v) - mean[c]).powi(2));
    let variance = squares
        .into_iter()
        .map(|s| (s / count as f64) as f32)
        .collect();
    (mean.into_iter().map(|m| m as f32).collect(), variance)
}

/// `x = activation(x * scale + shift)` for every channel, in place.
///
/// # Panics
/// If `scale` or `shift` has not one element for each channel.
pub fn scale_shift(
    _isa: Isa,
    tensor: &mut Tensor,
    scale: &[f32],
    shift: &[f32],
    activation: Activation,
) {
    let (h, w, channels) = (tensor.height(), tensor.width(), tensor.channels());
    assert_eq!(
        (scale.len(), shift.len()),
        (channels, channels),
        "elements of scale and shift"
    );
    let (row, pixel) = (tensor.row_stride(), tensor.channel_stride());
    tensor
        .as_mut_slice()
        .par_chunks_exact_mut(row)
        .skip(1)
        .take(h)
        .for_each(|line| {
            for x in 0..w {
                for (c, v) in line[(x + 1) * pixel..][..channels].iter_mut().enumerate() {
                    *v = activation.apply(*v * scale[c] + shift[c]);
                }
            }
        });
}
