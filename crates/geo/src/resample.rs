//! Antialiased bilinear resampling with missing data, streamed over source rows.

use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::RasterPatch;

/// Least share of an output pixel's weight that must fall on data.
const MIN_VALID_WEIGHT: f32 = 0.5 - 1e-4;

/// Weights of the source pixels `start..start + weights.len()` in one output pixel.
#[derive(Debug, Clone, PartialEq)]
struct Taps {
    start: usize,
    weights: Vec<f32>,
}

/// How each output pixel along an axis is made of source pixels.
///
/// The filter is a triangle over the source, as wide as two output pixels when reducing and two
/// source pixels when enlarging (Pillow's `BILINEAR`). Weights sum to one over the whole triangle;
/// those that fall outside the source are left out, so their share counts as missing.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    /// First source pixel in use.
    pub source_start: usize,
    /// One past the last.
    pub source_end: usize,
    taps: Vec<Taps>,
    /// Sum of the weights inside the source.
    inside: Vec<f32>,
}

impl Axis {
    /// `count` output pixels over `[start, start + length)` of a source of `source_len` pixels.
    pub fn new(start: f64, length: f64, count: usize, source_len: usize) -> Self {
        let scale = length / count as f64;
        let support = scale.max(1.0);
        let mut taps = Vec::with_capacity(count);
        for i in 0..count {
            let center = start + (i as f64 + 0.5) * scale;
            let first = (center - support - 0.5).floor() as i64;
            let last = (center + support + 0.5).ceil() as i64;
            let weight = |k: i64| (1.0 - ((k as f64 + 0.5 - center) / support).abs()).max(0.0);
            let sum: f64 = (first..=last).map(weight).sum();
            let inside_first = first.max(0);
            let inside_last = last.min(source_len as i64 - 1);
            let mut tap = Taps {
                start: 0,
                weights: Vec::new(),
            };
            for k in inside_first..=inside_last {
                let w = (weight(k) / sum) as f32;
                if w <= 0.0 {
                    continue;
                }
                if tap.weights.is_empty() {
                    tap.start = k as usize;
                }
                tap.weights.push(w);
            }
            taps.push(tap);
        }
        let used = || taps.iter().filter(|t| !t.weights.is_empty());
        let source_start = used().map(|t| t.start).min().unwrap_or(0);
        let source_end = used().map(|t| t.start + t.weights.len()).max().unwrap_or(0);
        let inside = taps.iter().map(|t| t.weights.iter().sum()).collect();
        Self {
            source_start,
            source_end,
            taps,
            inside,
        }
    }

    /// Whether no output pixel touches the source.
    pub fn is_empty(&self) -> bool {
        self.source_end <= self.source_start
    }
}

/// Source rows of a resampling, interleaved RGB and mask (255 data, 0 none), over the columns that
/// the horizontal axis uses.
pub(crate) struct SourceRows {
    /// First row.
    pub first_row: usize,
    /// Rows held.
    pub rows: usize,
    /// Pixels in a row.
    pub width: usize,
    /// `rows * width * 3` bytes.
    pub rgb: Vec<u8>,
    /// `rows * width` bytes; `None` if all have data.
    pub mask: Option<Vec<u8>>,
}

/// Collects source rows, in order, into an output patch.
pub(crate) struct Resampler {
    across: Axis,
    down: Axis,
    out_w: usize,
    out_h: usize,
    /// Weighted colours, `out_h * out_w * 3`.
    colour: Vec<f32>,
    /// Weight that fell on data, `out_h * out_w`.
    weight: Vec<f32>,
}

impl Resampler {
    pub fn new(across: Axis, down: Axis) -> Self {
        let (out_w, out_h) = (across.taps.len(), down.taps.len());
        let colour = vec![0.0; out_w * out_h * 3];
        let weight = vec![0.0; out_w * out_h];
        Self {
            across,
            down,
            out_w,
            out_h,
            colour,
            weight,
        }
    }

    /// Adds source rows. Each must be given once, in ascending order, so that sums are the same on
    /// any number of threads.
    pub fn add(&mut self, source: &SourceRows) {
        let out_w = self.out_w;
        let across = &self.across;
        let mut colour = vec![0.0_f32; source.rows * out_w * 3];
        let mut weight = vec![0.0_f32; source.rows * out_w];
        colour
            .par_chunks_mut(out_w * 3)
            .zip(weight.par_chunks_mut(out_w))
            .enumerate()
            .with_min_len(8)
            .for_each(|(row, (colour, weight))| {
                let rgb = &source.rgb[row * source.width * 3..(row + 1) * source.width * 3];
                match &source.mask {
                    None => across.filter_row(rgb, colour, weight),
                    Some(mask) => {
                        let mask = &mask[row * source.width..(row + 1) * source.width];
                        across.filter_masked_row(rgb, mask, colour, weight);
                    }
                }
            });
        let (first, end) = (source.first_row, source.first_row + source.rows);
        let down = &self.down;
        self.colour
            .par_chunks_mut(out_w * 3)
            .zip(self.weight.par_chunks_mut(out_w))
            .enumerate()
            .with_min_len(8)
            .for_each(|(j, (out_colour, out_weight))| {
                let taps = &down.taps[j];
                for (k, &w) in taps.weights.iter().enumerate() {
                    let y = taps.start + k;
                    if y < first || y >= end {
                        continue;
                    }
                    let row = y - first;
                    let from = &colour[row * out_w * 3..(row + 1) * out_w * 3];
                    for (o, &c) in out_colour.iter_mut().zip(from) {
                        *o += w * c;
                    }
                    let from = &weight[row * out_w..(row + 1) * out_w];
                    for (o, &c) in out_weight.iter_mut().zip(from) {
                        *o += w * c;
                    }
                }
            });
    }

    /// The patch: colours divided by the weight on data.
    pub fn finish(self) -> RasterPatch {
        let (width, height) = (self.out_w as u32, self.out_h as u32);
        let mut rgb = RgbImage::new(width, height);
        let mut valid = GrayImage::new(width, height);
        for (i, (pixel, seen)) in rgb.pixels_mut().zip(valid.pixels_mut()).enumerate() {
            let weight = self.weight[i];
            if weight < MIN_VALID_WEIGHT {
                continue;
            }
            for c in 0..3 {
                pixel.0[c] = (self.colour[i * 3 + c] / weight + 0.5) as u8;
            }
            seen.0[0] = 255;
        }
        RasterPatch { rgb, valid }
    }
}

impl Axis {
    fn filter_row(&self, rgb: &[u8], colour: &mut [f32], weight: &mut [f32]) {
        for (i, taps) in self.taps.iter().enumerate() {
            if taps.weights.is_empty() {
                continue;
            }
            let from = (taps.start - self.source_start) * 3;
            let pixels = &rgb[from..from + taps.weights.len() * 3];
            let mut sum = [0.0_f32; 3];
            for (pixel, &w) in pixels.chunks_exact(3).zip(&taps.weights) {
                for c in 0..3 {
                    sum[c] += w * f32::from(pixel[c]);
                }
            }
            colour[i * 3..i * 3 + 3].copy_from_slice(&sum);
            weight[i] = self.inside[i];
        }
    }

    fn filter_masked_row(&self, rgb: &[u8], mask: &[u8], colour: &mut [f32], weight: &mut [f32]) {
        for (i, taps) in self.taps.iter().enumerate() {
            if taps.weights.is_empty() {
                continue;
            }
            let from = taps.start - self.source_start;
            let pixels = &rgb[from * 3..(from + taps.weights.len()) * 3];
            let seen = &mask[from..from + taps.weights.len()];
            let mut sum = [0.0_f32; 3];
            let mut total = 0.0_f32;
            for ((pixel, &w), &seen) in pixels.chunks_exact(3).zip(&taps.weights).zip(seen) {
                let w = if seen == 0 { 0.0 } else { w };
                for c in 0..3 {
                    sum[c] += w * f32::from(pixel[c]);
                }
                total += w;
            }
            colour[i * 3..i * 3 + 3].copy_from_slice(&sum);
            weight[i] = total;
        }
    }
}
