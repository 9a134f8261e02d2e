//! Bilinear upsampling.

use crate::buffer::AlignedBuffer;
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::{Isa, Tensor};

/// The two input coordinates of an output coordinate, and the weight of the second (pixel centres at half-integers,
/// PyTorch's `align_corners=False`).
#[inline(always)]
pub(crate) fn source(out: usize, out_size: usize, in_size: usize) -> (usize, usize, f32) {
    let at = ((out as f32 + 0.5) * (in_size as f32 / out_size as f32) - 0.5).max(0.0);
    let first = (at as usize).min(in_size - 1);
    (first, (first + 1).min(in_size - 1), at - first as f32)
}

/// `dst += bilinear(src)`, where `src` is resized to the height and width of `dst` (`align_corners=False`).
///
/// # Panics
/// If the numbers of channels differ, or `src` is empty and `dst` is not.
pub fn upsample_bilinear_add(isa: Isa, src: &Tensor, dst: &mut Tensor) {
    assert_eq!(
        src.channels(),
        dst.channels(),
        "channels of the two tensors"
    );
    let (height, width) = (dst.height(), dst.width());
    assert!(
        src.height() * src.width() > 0 || height * width == 0,
        "cannot upsample the empty {src:?}"
    );
    let (row, pixel) = (dst.row_stride(), dst.channel_stride());
    let isa = isa.for_stride(pixel);
    let out = SharedMut::new(dst.as_mut_slice());
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        let (upper, lower, down) = source(y, height, src.height());
        let line = |y: usize| &src.as_slice()[src.offset(y + 1, 1)..][..src.width() * pixel];
        // SAFETY: the pixels of an output row, which belongs to this task.
        let out =
            unsafe { std::slice::from_raw_parts_mut(out.at((y + 1) * row + pixel), width * pixel) };
        isa.run(AddRow {
            upper: line(upper),
            lower: line(lower),
            down,
            out,
            pixel,
        });
    });
}

struct AddRow<'a> {
    upper: &'a [f32],
    lower: &'a [f32],
    /// Weight of the lower line.
    down: f32,
    out: &'a mut [f32],
    pixel: usize,
}

impl Kernel for AddRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let pixel = self.pixel;
        let (in_width, out_width) = (self.upper.len() / pixel, self.out.len() / pixel);
        assert!(
            self.lower.len() == self.upper.len() && in_width > 0 && pixel.is_multiple_of(S::LANES)
        );
        let down = simd.splat(self.down);
        for x in 0..out_width {
            let (left, right, across) = source(x, out_width, in_width);
            let across = simd.splat(across);
            for c in (0..pixel).step_by(S::LANES) {
                let between = |a, b, weight| simd.mul_add(weight, simd.sub(b, a), a);
                // SAFETY: both columns are below `in_width`; pixels are whole vectors.
                unsafe {
                    let line = |line: &[f32]| {
                        let at = |x: usize| simd.load(line.as_ptr().add(x * pixel + c));
                        between(at(left), at(right), across)
                    };
                    let value = between(line(self.upper), line(self.lower), down);
                    let out = self.out.as_mut_ptr().add(x * pixel + c);
                    simd.store(out, simd.add(simd.load(out), value));
                }
            }
        }
    }
}
