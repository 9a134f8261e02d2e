//! The network's input: a picture as floats, as bytes, and as grey cells.

use grimnet_kernels::{ByteScale, ByteTensor, Tensor};
use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::NetSpec;
use crate::spec::KEYPOINT_CELL_PX;

const CELL: usize = KEYPOINT_CELL_PX as usize;

/// Converts bytes to the network's input: (v / 255 - mean) / std.
pub(crate) struct InputNorm {
    /// For each channel and byte.
    values: [[f32; 256]; 3],
}

impl InputNorm {
    pub(crate) fn new(spec: &NetSpec) -> Self {
        let value =
            |c: usize, v: usize| (v as f32 / 255.0 - spec.input_mean[c]) / spec.input_std[c];
        Self {
            values: std::array::from_fn(|c| std::array::from_fn(|v| value(c, v))),
        }
    }

    /// Fills `input`. Masked pixels are 0, the mean colour.
    pub(crate) fn fill(&self, image: &RgbImage, mask: Option<&GrayImage>, input: &mut Tensor) {
        let (width, height) = (image.width() as usize, image.height() as usize);
        input.reshape(height, width, 3);
        let pitch = input.pixel_pitch();
        let [red, green, blue] = &self.values;
        let (pixels, _) = image.as_raw().as_chunks::<3>();
        input
            .par_rows_mut()
            .zip(pixels.par_chunks_exact(width))
            .enumerate()
            .for_each(|(y, (row, pixels))| {
                for (out, &[r, g, b]) in row.chunks_exact_mut(pitch).zip(pixels) {
                    out[..3].copy_from_slice(&[
                        red[r as usize],
                        green[g as usize],
                        blue[b as usize],
                    ]);
                }
                if let Some(mask) = mask {
                    let seen = &mask.as_raw()[y * width..][..width];
                    let unseen = row
                        .chunks_exact_mut(pitch)
                        .zip(seen)
                        .filter(|&(_, &seen)| seen == 0);
                    unseen.for_each(|(out, _)| out[..3].fill(0.0));
                }
            });
    }

    /// The cells of [`grey_cells`] without the floats between: the same values.
    pub(crate) fn fill_grey_cells(
        &self,
        image: &RgbImage,
        mask: Option<&GrayImage>,
        grey: &mut Tensor,
    ) {
        let (width, height) = (image.width() as usize, image.height() as usize);
        grey.reshape(height / CELL, width / CELL, CELL * CELL);
        let pitch = grey.pixel_pitch();
        let [red, green, blue] = &self.values;
        let (pixels, _) = image.as_raw().as_chunks::<3>();
        let rows = grey
            .par_rows_mut()
            .zip(pixels.par_chunks_exact(CELL * width));
        rows.enumerate().for_each(|(cell_y, (cells, pixels))| {
            for (dy, row) in pixels.chunks_exact(width).enumerate() {
                for (cell, pixels) in cells.chunks_exact_mut(pitch).zip(row.chunks_exact(CELL)) {
                    for (out, &[r, g, b]) in cell[dy * CELL..][..CELL].iter_mut().zip(pixels) {
                        *out = (red[r as usize] + green[g as usize] + blue[b as usize]) / 3.0;
                    }
                }
                let Some(mask) = mask else { continue };
                let seen = &mask.as_raw()[(cell_y * CELL + dy) * width..][..width];
                for (cell, seen) in cells.chunks_exact_mut(pitch).zip(seen.chunks_exact(CELL)) {
                    let line = cell[dy * CELL..][..CELL].iter_mut().zip(seen);
                    line.filter(|&(_, &seen)| seen == 0)
                        .for_each(|(out, _)| *out = 0.0);
                }
            }
        });
    }
}

/// The mean of the input's channels, each 8 x 8 cell as 64 channels in raster order (PyTorch's `pixel_unshuffle`).
pub(crate) fn grey_cells(input: &Tensor, grey: &mut Tensor) {
    grey.reshape(input.height() / CELL, input.width() / CELL, CELL * CELL);
    let (from, to) = (input.pixel_pitch(), grey.pixel_pitch());
    grey.par_rows_mut().enumerate().for_each(|(cell_y, cells)| {
        for dy in 0..CELL {
            let row = input.row(cell_y * CELL + dy);
            for (cell, pixels) in cells
                .chunks_exact_mut(to)
                .zip(row.chunks_exact(CELL * from))
            {
                for (out, pixel) in cell[dy * CELL..][..CELL]
                    .iter_mut()
                    .zip(pixels.chunks_exact(from))
                {
                    *out = (pixel[0] + pixel[1] + pixel[2]) / 3.0;
                }
            }
        }
    });
}

/// What the bytes of a picture stand for.
pub(crate) fn picture_scale(spec: &NetSpec) -> ByteScale {
    ByteScale {
        scale: spec
            .input_std
            .iter()
            .map(|std| 1.0 / (255.0 * std))
            .collect(),
        zero: spec.input_mean.iter().map(|mean| 255.0 * mean).collect(),
    }
}

/// Fills `bytes` with a picture, four bytes a pixel. Masked pixels are `zero`, the mean colour, as the halo.
pub(crate) fn fill_bytes(
    image: &RgbImage,
    mask: Option<&GrayImage>,
    zero: [u8; 3],
    bytes: &mut ByteTensor,
) {
    let (width, height) = (image.width() as usize, image.height() as usize);
    bytes.reshape_picture(height, width, zero);
    let (pixels, _) = image.as_raw().as_chunks::<3>();
    bytes
        .par_rows_mut()
        .zip(pixels.par_chunks_exact(width))
        .enumerate()
        .for_each(|(y, (row, pixels))| {
            let (row, _) = row.as_chunks_mut::<4>();
            for (out, &[r, g, b]) in row.iter_mut().zip(pixels) {
                *out = [r, g, b, 0];
            }
            if let Some(mask) = mask {
                let seen = &mask.as_raw()[y * width..][..width];
                for (out, _) in row.iter_mut().zip(seen).filter(|&(_, &seen)| seen == 0) {
                    *out = [zero[0], zero[1], zero[2], 0];
                }
            }
        });
}
