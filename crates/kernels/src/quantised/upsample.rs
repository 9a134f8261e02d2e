//! Sums of activations of different resolution, as bytes.
//!
//! Multiplications and additions are not fused here, so that all instruction sets give the same bytes.

use super::dots::byte_from;
use super::tensor::{ByteTensor, byte_pitch};
use super::weights::ByteScale;
use crate::buffer::AlignedBuffer;
use crate::parallel::{SharedMut, for_each};
use crate::resize::source;
use crate::simd::PlainKernel;
use crate::{Isa, Tensor};

/// `dst += bilinear(src)` as [`crate::upsample_bilinear_add`], with the same floats on all instruction sets.
///
/// # Panics
/// As [`crate::upsample_bilinear_add`].
pub fn upsample_add_exact(isa: Isa, src: &Tensor, dst: &mut Tensor) {
    check(src, [dst.height(), dst.width(), dst.channels()]);
    let (height, width, pixel) = (dst.height(), dst.width(), dst.channel_stride());
    let row = dst.row_stride();
    let out = SharedMut::new(dst.as_mut_slice());
    for_each(
        &mut AlignedBuffer::default(),
        width * pixel,
        height,
        |line, y| {
            // SAFETY: the pixels of an output row, which belongs to this task.
            let out = unsafe {
                std::slice::from_raw_parts_mut(out.at((y + 1) * row + pixel), width * pixel)
            };
            isa.vectorise(AddRow {
                line: Line::new(src, y, height, line),
                out,
            });
        },
    );
}

/// The sum of bytes and an upsampled tensor, as bytes of another scale.
pub struct UpsampledSum {
    channels: usize,
    zero_bytes: Vec<u8>,
    /// Steps of the output in one of the input, in 1, and the zero of the output; with padding.
    of_byte: Vec<f32>,
    of_one: Vec<f32>,
    zero: Vec<f32>,
}

impl UpsampledSum {
    /// For bytes that stand for `input`, whose zeros are bytes 0, and a sum that stands for `output`.
    ///
    /// # Panics
    /// If the numbers of channels differ.
    #[must_use]
    pub fn new(input: &ByteScale, output: &ByteScale) -> Self {
        let channels = output.scale.len();
        assert_eq!(channels, input.scale.len(), "channels of the two scales");
        let padded = |values: &mut dyn Iterator<Item = f32>| {
            let mut values: Vec<f32> = values.collect();
            values.resize(byte_pitch(channels), 0.0);
            values
        };
        let scales = || input.scale.iter().zip(&output.scale);
        Self {
            channels,
            zero_bytes: output.zero_bytes(),
            of_byte: padded(&mut scales().map(|(from, to)| from / to)),
            of_one: padded(&mut output.scale.iter().map(|to| 1.0 / to)),
            zero: padded(&mut output.zero.iter().copied()),
        }
    }

    /// `output = bytes + bilinear(src)`, where `src` is resized to the height and width of `bytes` (PyTorch's
    /// `align_corners=False`), rounded to the nearest byte, ties to even.
    ///
    /// # Panics
    /// If the numbers of channels differ, there are four or fewer, or `src` is empty and `bytes` is not.
    pub fn run(&self, isa: Isa, bytes: &ByteTensor, src: &Tensor, output: &mut ByteTensor) {
        let (height, width, pixel) = (bytes.height(), bytes.width(), bytes.pixel_pitch());
        check(src, [height, width, self.channels]);
        assert_eq!(bytes.channels(), self.channels, "channels of the bytes");
        assert_eq!(src.channel_stride(), pixel, "elements from pixel to pixel");
        output.reshape(height, width, &self.zero_bytes);
        let rows = output.row_stride();
        let out = SharedMut::new(output.as_mut_slice());
        for_each(
            &mut AlignedBuffer::default(),
            width * pixel,
            height,
            |line, y| {
                // SAFETY: the pixels of an output row, which belongs to this task.
                let out = unsafe {
                    std::slice::from_raw_parts_mut(out.at((y + 1) * rows + pixel), width * pixel)
                };
                isa.vectorise(BytesRow {
                    line: Line::new(src, y, height, line),
                    bytes: bytes.row(y),
                    sum: self,
                    out,
                });
            },
        );
    }
}

fn check(src: &Tensor, [height, width, channels]: [usize; 3]) {
    assert_eq!(src.channels(), channels, "channels of the two tensors");
    assert!(
        src.height() * src.width() > 0 || height * width == 0,
        "cannot upsample the empty {src:?}"
    );
}

/// A row of the upsampled tensor, to be computed.
struct Line<'a> {
    upper: &'a [f32],
    lower: &'a [f32],
    /// Weight of the lower row.
    down: f32,
    pixel: usize,
    out: &'a mut [f32],
}

impl<'a> Line<'a> {
    fn new(src: &'a Tensor, y: usize, height: usize, out: &'a mut [f32]) -> Self {
        let (upper, lower, down) = source(y, height, src.height());
        Self {
            upper: src.row(upper),
            lower: src.row(lower),
            down,
            pixel: src.channel_stride(),
            out,
        }
    }

    #[inline(always)]
    fn compute(self) -> &'a [f32] {
        let Self {
            upper,
            lower,
            down,
            pixel,
            out,
        } = self;
        let (out_width, in_width) = (out.len() / pixel, upper.len() / pixel);
        for (x, out) in out.chunks_exact_mut(pixel).enumerate() {
            let (left, right, across) = source(x, out_width, in_width);
            let [a, b] = [left, right].map(|x| &upper[x * pixel..][..pixel]);
            let [c, d] = [left, right].map(|x| &lower[x * pixel..][..pixel]);
            for ((((out, a), b), c), d) in out.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                let (above, below) = (a + (b - a) * across, c + (d - c) * across);
                *out = above + (below - above) * down;
            }
        }
        out
    }
}

struct AddRow<'a> {
    line: Line<'a>,
    out: &'a mut [f32],
}

impl PlainKernel for AddRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let line = self.line.compute();
        self.out.iter_mut().zip(line).for_each(|(out, v)| *out += v);
    }
}

struct BytesRow<'a> {
    line: Line<'a>,
    bytes: &'a [u8],
    sum: &'a UpsampledSum,
    out: &'a mut [u8],
}

impl PlainKernel for BytesRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let UpsampledSum {
            of_byte,
            of_one,
            zero,
            ..
        } = self.sum;
        let pixel = self.line.pixel;
        let line = self.line.compute();
        let pixels = self
            .out
            .chunks_exact_mut(pixel)
            .zip(self.bytes.chunks_exact(pixel))
            .zip(line.chunks_exact(pixel));
        let (of_byte, of_one, zero) = (&of_byte[..pixel], &of_one[..pixel], &zero[..pixel]);
        for ((out, bytes), line) in pixels {
            for i in 0..pixel {
                let value = f32::from(bytes[i]) * of_byte[i] + line[i] * of_one[i] + zero[i];
                out[i] = byte_from(value);
            }
        }
    }
}
