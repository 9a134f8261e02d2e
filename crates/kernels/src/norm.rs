//! Moments of channels, and the affine map of a normalisation.

use crate::buffer::AlignedBuffer;
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::{Activation, Isa, Tensor};

/// Rows of pixels that one task sums.
const BAND: usize = 8;
/// Pixels that are summed in `f32` before the sum is added to an `f64`.
const RUN: usize = 32;

/// Mean and biased variance of every channel over the pixels whose `mask` (`height x width`) is not zero, or over all.
///
/// The variance is computed around the mean in a second pass. Short runs of pixels are summed in `f32`, their sums in `f64`
/// in a fixed order, so the result does not depend on the number of threads. If there is no pixel, the mean is 0 and the
/// variance 1, so that normalisation is the identity.
///
/// # Panics
/// If the mask does not have `height x width` elements.
#[must_use]
pub fn channel_moments(isa: Isa, tensor: &Tensor, mask: Option<&[u8]>) -> (Vec<f32>, Vec<f32>) {
    let (height, width, channels) = (tensor.height(), tensor.width(), tensor.channels());
    if let Some(mask) = mask {
        assert_eq!(
            mask.len(),
            height * width,
            "elements of the mask of {tensor:?}"
        );
    }
    let count = mask.map_or(height * width, |mask| {
        mask.iter().filter(|&&seen| seen != 0).count()
    });
    if count == 0 {
        return (vec![0.0; channels], vec![1.0; channels]);
    }
    let pixel = tensor.channel_stride();
    let isa = isa.for_stride(pixel);
    let average = |centre: &[f32], square: bool| -> Vec<f32> {
        let bands = height.div_ceil(BAND);
        // An `f64` takes the memory of two floats.
        let mut sums = vec![0.0f64; bands * pixel];
        let out: SharedMut = SharedMut::new(bytemuck::cast_slice_mut(&mut sums));
        for_each(&mut AlignedBuffer::default(), 0, bands, |_, band| {
            // SAFETY: the sums of a band, which belong to this task; the memory is that of `f64`s.
            let sums = unsafe {
                std::slice::from_raw_parts_mut(out.at(2 * band * pixel).cast::<f64>(), pixel)
            };
            for y in band * BAND..height.min((band + 1) * BAND) {
                let line = &tensor.as_slice()[tensor.offset(y + 1, 1)..][..width * pixel];
                isa.run(SumRow {
                    line,
                    mask: mask.map(|mask| &mask[y * width..][..width]),
                    centre,
                    square,
                    sums,
                });
            }
        });
        (0..channels)
            .map(|c| (sums[c..].iter().step_by(pixel).sum::<f64>() / count as f64) as f32)
            .collect()
    };
    let mut mean = average(&vec![0.0; pixel], false);
    mean.resize(pixel, 0.0);
    let variance = average(&mean, true);
    mean.truncate(channels);
    (mean, variance)
}

/// Adds `x - centre`, or its square, of the visible pixels of a row to the sums.
struct SumRow<'a> {
    line: &'a [f32],
    mask: Option<&'a [u8]>,
    centre: &'a [f32],
    square: bool,
    sums: &'a mut [f64],
}

impl Kernel for SumRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let pixel = self.centre.len();
        assert!(self.sums.len() == pixel && pixel.is_multiple_of(S::LANES));
        let width = self.line.len() / pixel;
        for c in (0..pixel).step_by(S::LANES) {
            // SAFETY: `centre` has whole vectors.
            let centre = unsafe { simd.load(self.centre.as_ptr().add(c)) };
            for first in (0..width).step_by(RUN) {
                let mut sum = simd.zero();
                for x in first..width.min(first + RUN) {
                    if self.mask.is_some_and(|mask| mask[x] == 0) {
                        continue;
                    }
                    // SAFETY: `x` is below the width; pixels are whole vectors.
                    let value = simd.sub(
                        unsafe { simd.load(self.line.as_ptr().add(x * pixel + c)) },
                        centre,
                    );
                    sum = if self.square {
                        simd.mul_add(value, value, sum)
                    } else {
                        simd.add(sum, value)
                    };
                }
                let mut lanes = [0.0f32; 16];
                // SAFETY: no vector has more than 16 lanes.
                unsafe { simd.store(lanes.as_mut_ptr(), sum) };
                for (total, &lane) in self.sums[c..c + S::LANES].iter_mut().zip(&lanes) {
                    *total += f64::from(lane);
                }
            }
        }
    }
}

/// `x = activation(x * scale + shift)` for every channel, in place.
///
/// # Panics
/// If `scale` or `shift` does not have one element for each channel.
pub fn scale_shift(
    isa: Isa,
    tensor: &mut Tensor,
    scale: &[f32],
    shift: &[f32],
    activation: Activation,
) {
    let (height, width, channels) = (tensor.height(), tensor.width(), tensor.channels());
    assert_eq!(
        (scale.len(), shift.len()),
        (channels, channels),
        "elements of scale and shift"
    );
    let (row, pixel) = (tensor.row_stride(), tensor.channel_stride());
    let out = SharedMut::new(tensor.as_mut_slice());
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        // SAFETY: the pixels of a row, which belongs to this task.
        let line =
            unsafe { std::slice::from_raw_parts_mut(out.at((y + 1) * row + pixel), width * pixel) };
        isa.run(ScaleRow {
            line,
            pixel,
            scale,
            shift,
            activation,
        });
    });
}

struct ScaleRow<'a> {
    line: &'a mut [f32],
    pixel: usize,
    scale: &'a [f32],
    shift: &'a [f32],
    activation: Activation,
}

impl Kernel for ScaleRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        assert!(self.pixel >= self.scale.len() && self.shift.len() == self.scale.len());
        let whole = self.scale.len() / S::LANES * S::LANES;
        for pixel in self.line.chunks_exact_mut(self.pixel) {
            for c in (0..whole).step_by(S::LANES) {
                // SAFETY: a whole vector of channels, which the pixel, scale and shift have.
                unsafe {
                    let (scale, shift) = (
                        simd.load(self.scale.as_ptr().add(c)),
                        simd.load(self.shift.as_ptr().add(c)),
                    );
                    let value = simd.mul_add(simd.load(pixel.as_ptr().add(c)), scale, shift);
                    let value = match self.activation {
                        Activation::Identity => value,
                        Activation::Relu => simd.max(simd.zero(), value),
                    };
                    simd.store(pixel.as_mut_ptr().add(c), value);
                }
            }
            // The padding channels stay as they are: zero.
            let rest = pixel[whole..]
                .iter_mut()
                .zip(&self.scale[whole..])
                .zip(&self.shift[whole..]);
            for ((value, scale), shift) in rest {
                *value = self.activation.apply(*value * scale + shift);
            }
        }
    }
}
