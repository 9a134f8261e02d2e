//! Bilinear upsampling.

use rayon::prelude::*;

use crate::{Isa, Tensor};

/// For an output coordinate: the two input coordinates and the weight of the second
/// (pixel centres at half-integers, PyTorch's `align_corners=False`).
fn source(out: usize, out_size: usize, in_size: usize) -> (usize, usize, f32) {
    let at = ((out as f32 + 0.5) * (in_size as f32 / out_size as f32) - 0.5).max(0.0);
    let first = (at as usize).min(in_size - 1);
    (first, (first + 1).min(in_size - 1), at - first as f32)
}

/// `dst += bilinear(src)`, `src` resized to the height and width of `dst` (`align_corners=False`).
///
/// # Panics
/// If the channels differ, or `src` is empty where `dst` is not.
pub fn upsample_bilinear_add(_isa: Isa, src: &Tensor, dst: &mut Tensor) {
    assert_eq!(
        src.channels(),
        dst.channels(),
        "channels of the two tensors"
    );
    let (h, w, channels) = (dst.height(), dst.width(), dst.channels());
    let (row, pixel) = (dst.row_stride(), dst.channel_stride());
    dst.as_mut_slice()
        .par_chunks_exact_mut(row)
        .skip(1)
        .take(h)
        .enumerate()
        .for_each(|(y, line)| {
            let (y0, y1, fy) = source(y, h, src.height());
            for x in 0..w {
                let (x0, x1, fx) = source(x, w, src.width());
                let (a, b, c, d) = (
                    src.pixel(y0, x0),
                    src.pixel(y0, x1),
                    src.pixel(y1, x0),
                    src.pixel(y1, x1),
                );
                for (i, out) in line[(x + 1) * pixel..][..channels].iter_mut().enumerate() {
                    let top = a[i] + fx * (b[i] - a[i]);
                    let bottom = c[i] + fx * (d[i] - c[i]);
                    *out += top + fy * (bottom - top);
                }
            }
        });
}
