//! Max pooling.

use rayon::prelude::*;

use crate::{Isa, Tensor};

/// Maximum over 2 x 2 pixels, stride 2. `output` is reshaped to `h / 2 x w / 2` (an odd last row or column is dropped,
/// as in PyTorch's `max_pool2d(2)`).
pub fn max_pool_2x2(_isa: Isa, input: &Tensor, output: &mut Tensor) {
    let (oh, ow, channels) = (input.height() / 2, input.width() / 2, input.channels());
    output.reshape(oh, ow, channels);
    let (row, pixel) = (output.row_stride(), output.channel_stride());
    output
        .as_mut_slice()
        .par_chunks_exact_mut(row)
        .skip(1)
        .take(oh)
        .enumerate()
        .for_each(|(y, line)| {
            for x in 0..ow {
                let at = |dy, dx| input.pixel(2 * y + dy, 2 * x + dx);
                let (a, b, c, d) = (at(0, 0), at(0, 1), at(1, 0), at(1, 1));
                for (i, out) in line[(x + 1) * pixel..][..channels].iter_mut().enumerate() {
                    *out = a[i].max(b[i]).max(c[i].max(d[i]));
                }
            }
        });
}
