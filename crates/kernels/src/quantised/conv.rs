//! Convolution of bytes.

use super::dots::Dots;
use super::pack::PackedWeights;
use super::tensor::{ByteTensor, WORD, byte_pitch};
use super::tile::{Input, Output, Rows, Start};
use super::weights::{QuantisedWeights, check_lengths};
use crate::buffer::AlignedBuffer;
use crate::cache::l2_bytes;
use crate::parallel::{SharedMut, for_each};
use crate::tensor::channel_stride;
use crate::{ConvSpec, Isa, KernelError, Tensor};

/// The input rows of a task, which are read again for each panel, take this part of the L2 cache.
const BANDS_IN_L2: usize = 4;
/// Tasks for each worker.
const TASKS: usize = 4;

/// A convolution of bytes, computed directly with exact sums. The padding is `kernel / 2` pixels of the input's halo on every side.
pub struct QuantisedConv2d {
    spec: ConvSpec,
    /// Bytes from one pixel of the input to the next.
    pitch: usize,
    weights: PackedWeights,
    /// What the sums are multiplied by, one for each output channel, padding included.
    factors: AlignedBuffer,
}

impl QuantisedConv2d {
    /// Prepares a convolution. `factors`, one for each output channel, not negative, turn sums into the output:
    /// [`QuantisedWeights::unit`] for floats, divided by the output's scale for bytes.
    ///
    /// # Errors
    /// [`KernelError`] if the specification is not supported or a slice has the wrong length.
    pub fn new(
        isa: Isa,
        spec: ConvSpec,
        weights: &QuantisedWeights,
        factors: &[f32],
    ) -> Result<Self, KernelError> {
        Self::with_dots(
            Dots::of(isa),
            spec,
            byte_pitch(spec.in_channels),
            weights,
            factors,
        )
    }

    /// [`QuantisedConv2d::new`] for the three colours of a picture ([`ByteTensor::reshape_picture`]).
    ///
    /// # Errors
    /// As [`QuantisedConv2d::new`].
    pub fn of_picture(
        isa: Isa,
        spec: ConvSpec,
        weights: &QuantisedWeights,
        factors: &[f32],
    ) -> Result<Self, KernelError> {
        Self::with_dots(Dots::of(isa), spec, WORD, weights, factors)
    }

    fn with_dots(
        dots: Dots,
        spec: ConvSpec,
        pitch: usize,
        weights: &QuantisedWeights,
        factors: &[f32],
    ) -> Result<Self, KernelError> {
        spec.validate()?;
        check_lengths(spec, weights.values.len(), weights.start.len())?;
        check_lengths(spec, weights.values.len(), factors.len())?;
        if spec.in_channels > pitch {
            return Err(KernelError::ScaleLength {
                expected: pitch,
                found: spec.in_channels,
            });
        }
        let mut padded = AlignedBuffer::zeroed(byte_pitch(spec.out_channels));
        padded.as_mut_slice()[..factors.len()].copy_from_slice(factors);
        Ok(Self {
            spec,
            pitch,
            weights: PackedWeights::new(dots, spec, pitch, weights),
            factors: padded,
        })
    }

    /// Its shape.
    #[must_use]
    pub fn spec(&self) -> ConvSpec {
        self.spec
    }

    /// Runs the convolution with ReLU: `byte = max(sum, 0) * factor`, rounded to the nearest, ties to even, at most 255. Byte 0
    /// stands for zero. `output` is reshaped to `ceil(h / stride) x ceil(w / stride) x out_channels`.
    ///
    /// # Panics
    /// If `input` does not have `in_channels` channels.
    pub fn forward_relu(&self, input: &ByteTensor, output: &mut ByteTensor) {
        let spec = self.spec;
        let (height, width) = (
            spec.output_size(input.height()),
            spec.output_size(input.width()),
        );
        output.reshape(height, width, &vec![0; spec.out_channels]);
        let (row_step, pixel_step) = (output.row_stride(), output.pixel_pitch());
        let to = SharedMut::new(output.as_mut_slice());
        self.run(input, [height, width], |y, column| Output {
            // SAFETY: a pixel of the output.
            start: Start::Bytes(unsafe { to.at((y + 1) * row_step + pixel_step + column) }),
            row_step,
            pixel_step,
        });
    }

    /// Runs the convolution: `sum * factor`. `output` is reshaped to `ceil(h / stride) x ceil(w / stride) x out_channels`.
    ///
    /// # Panics
    /// If `input` does not have `in_channels` channels, or the output has four or fewer.
    pub fn forward(&self, input: &ByteTensor, output: &mut Tensor) {
        let spec = self.spec;
        assert_eq!(
            channel_stride(spec.out_channels),
            self.weights.columns,
            "floats from pixel to pixel for {} output channels",
            spec.out_channels
        );
        let (height, width) = (
            spec.output_size(input.height()),
            spec.output_size(input.width()),
        );
        output.reshape(height, width, spec.out_channels);
        let (row_step, pixel_step) = (output.row_stride(), output.channel_stride());
        let to = SharedMut::new(output.as_mut_slice());
        self.run(input, [height, width], |y, column| Output {
            // SAFETY: a pixel of the output.
            start: Start::Floats(unsafe { to.at((y + 1) * row_step + pixel_step + column) }),
            row_step,
            pixel_step,
        });
    }

    /// `output(row, column)`: where the panel from `column` on goes, from the first pixel of a row on.
    fn run(
        &self,
        input: &ByteTensor,
        [height, width]: [usize; 2],
        output: impl Fn(usize, usize) -> Output + Sync,
    ) {
        let spec = self.spec;
        assert_eq!(
            (input.channels(), input.pixel_pitch()),
            (spec.in_channels, self.pitch),
            "channels, and bytes from pixel to pixel, of the input of the convolution"
        );
        let panels = self.weights.panels();
        let halo = 1 - spec.kernel / 2;
        let workers = rayon::current_num_threads();
        let cached = l2_bytes() / BANDS_IN_L2 / (input.row_stride() * spec.stride).max(1);
        let share = match workers {
            1 => height,
            _ => (height * panels).div_ceil(TASKS * workers),
        };
        let band = share.clamp(1, cached.clamp(1, height.max(1)));
        for_each(
            &mut AlignedBuffer::default(),
            0,
            height.div_ceil(band) * panels,
            |_, task| {
                let (y, panel) = (task / panels * band, self.weights.panel(task % panels));
                // SAFETY: the words of all pixels lie inside the input with its halo, since the output is no larger than
                // input / stride, rounded up; there is a factor for each column; each output pixel and panel belongs to
                // one task.
                let rows = unsafe {
                    let first = input.offset(y * spec.stride + halo, halo);
                    Rows::new(
                        Input {
                            start: input.as_slice().as_ptr().add(first),
                            row_step: spec.stride * input.row_stride(),
                            pixel_step: spec.stride * self.pitch,
                            tap_rows: spec.kernel,
                            tap_row_step: input.row_stride(),
                            words: self.weights.words,
                        },
                        panel,
                        self.factors.as_slice().as_ptr().add(panel.column),
                        output(y, panel.column),
                        [band.min(height - y), width],
                    )
                };
                self.weights.dots.run(rows);
            },
        );
    }
}

#[cfg(test)]
mod tests;
