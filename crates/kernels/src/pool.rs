//! Max pooling.

use crate::buffer::AlignedBuffer;
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::{Isa, Tensor};

/// Maximum over 2 x 2 pixels, stride 2. `output` is reshaped to `h / 2 x w / 2` (an odd last row or column is ignored,
/// as in PyTorch's `max_pool2d(2)`).
pub fn max_pool_2x2(isa: Isa, input: &Tensor, output: &mut Tensor) {
    let (height, width) = (input.height() / 2, input.width() / 2);
    output.reshape(height, width, input.channels());
    let (row, pixel) = (output.row_stride(), output.channel_stride());
    let isa = isa.for_stride(pixel);
    let out = SharedMut::new(output.as_mut_slice());
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        let line = |y: usize| &input.as_slice()[input.offset(y + 1, 1)..][..2 * width * pixel];
        // SAFETY: the pixels of an output row, which belongs to this task.
        let out =
            unsafe { std::slice::from_raw_parts_mut(out.at((y + 1) * row + pixel), width * pixel) };
        isa.run(PoolRow {
            upper: line(2 * y),
            lower: line(2 * y + 1),
            out,
            pixel,
        });
    });
}

struct PoolRow<'a> {
    upper: &'a [f32],
    lower: &'a [f32],
    out: &'a mut [f32],
    pixel: usize,
}

impl Kernel for PoolRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let pixel = self.pixel;
        assert!(
            self.upper.len() == 2 * self.out.len()
                && self.lower.len() == 2 * self.out.len()
                && pixel.is_multiple_of(S::LANES)
        );
        for x in 0..self.out.len() / pixel {
            for c in (0..pixel).step_by(S::LANES) {
                // SAFETY: each line has two pixels for each pixel of the output; pixels are whole vectors.
                unsafe {
                    let largest = |line: &[f32]| {
                        let left = line.as_ptr().add(2 * x * pixel + c);
                        simd.max(simd.load(left), simd.load(left.add(pixel)))
                    };
                    let value = simd.max(largest(self.upper), largest(self.lower));
                    simd.store(self.out.as_mut_ptr().add(x * pixel + c), value);
                }
            }
        }
    }
}
