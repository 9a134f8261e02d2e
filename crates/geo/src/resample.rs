//! Antialiased bilinear resampling with missing data, streamed over source rows.

use std::collections::HashMap;

use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::RasterPatch;

/// Minimum share of the weight of an output pixel that must be on data.
const MIN_VALID_WEIGHT: f32 = 0.5 - 1e-4;

/// Weights of the source pixels `start..start + weights.len()` in one output pixel.
#[derive(Debug, Clone, PartialEq)]
struct Taps {
    start: usize,
    weights: Vec<f32>,
}

impl Taps {
    fn end(&self) -> usize {
        self.start + self.weights.len()
    }
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
            let centre = start + (i as f64 + 0.5) * scale;
            let first = (centre - support - 0.5).floor() as i64;
            let last = (centre + support + 0.5).ceil() as i64;
            let weight = |k: i64| (1.0 - ((k as f64 + 0.5 - centre) / support).abs()).max(0.0);
            let sum: f64 = (first..=last).map(weight).sum();
            let inside_first = first.max(0);
            let inside_last = last.min(source_len as i64 - 1);
            // Without weights, taps lie at the end that they are beyond: rows are found by bisection.
            let mut tap = Taps {
                start: if centre < 0.0 { 0 } else { source_len },
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
        let source_end = used().map(Taps::end).max().unwrap_or(0);
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

/// Source rows of a resampling, over the columns that the horizontal axis uses.
pub(crate) struct SourceRows {
    /// First row.
    pub first_row: usize,
    /// Rows held.
    pub rows: usize,
    /// Pixels in a row.
    pub width: usize,
    /// Interleaved RGB, `rows * width * 3`.
    pub rgb: Vec<u8>,
    /// 255 where there is data, 0 where not, `rows * width`; `None` if all have data.
    pub mask: Option<Vec<u8>>,
}

/// Source rows summed into one output row, not yet filtered across.
struct RowSum {
    /// `width * 3`.
    colour: Vec<f32>,
    /// Weight of the rows without a mask: the same for all pixels.
    plain_weight: f32,
    /// Weight on data of the rows with a mask, `width`; empty if there were none.
    masked_weight: Vec<f32>,
}

/// Collects source rows, in order, into an output patch.
pub(crate) struct Resampler {
    across: Axis,
    down: Axis,
    patch: RasterPatch,
    /// Sums of output rows that need further source rows.
    open: HashMap<usize, RowSum>,
}

impl Resampler {
    pub fn new(across: Axis, down: Axis) -> Self {
        let (out_w, out_h) = (across.taps.len() as u32, down.taps.len() as u32);
        let patch = RasterPatch {
            rgb: RgbImage::new(out_w, out_h),
            valid: GrayImage::new(out_w, out_h),
        };
        Self {
            across,
            down,
            patch,
            open: HashMap::new(),
        }
    }

    /// Adds source rows. Each must be given once, in ascending order; each output row sums its
    /// source rows in that order, so the answer is the same on any number of threads.
    pub fn add(&mut self, mut source: SourceRows) {
        source.blacken_missing();
        let (first, end) = (source.first_row, source.first_row + source.rows);
        let from = self.down.taps.partition_point(|t| t.end() <= first);
        let to = self.down.taps.partition_point(|t| t.start < end).max(from);
        let begun: Vec<Option<RowSum>> = (from..to).map(|j| self.open.remove(&j)).collect();
        let out_w = self.across.taps.len();
        let rgb: &mut [u8] = &mut self.patch.rgb;
        let valid: &mut [u8] = &mut self.patch.valid;
        let (across, down, source) = (&self.across, &self.down, &source);
        let unfinished: Vec<(usize, RowSum)> = rgb[from * out_w * 3..to * out_w * 3]
            .par_chunks_mut(out_w * 3)
            .zip(valid[from * out_w..to * out_w].par_chunks_mut(out_w))
            .zip(begun)
            .enumerate()
            .with_min_len(4)
            .filter_map(|(i, ((rgb, valid), begun))| {
                let taps = &down.taps[from + i];
                let mut sum = begun.unwrap_or_else(|| RowSum::new(source.width));
                for (k, &w) in taps.weights.iter().enumerate() {
                    let y = taps.start + k;
                    if (first..end).contains(&y) {
                        sum.add(source, y - first, w);
                    }
                }
                if taps.end() > end {
                    return Some((from + i, sum));
                }
                across.filter(&sum, rgb, valid);
                None
            })
            .collect();
        self.open.extend(unfinished);
    }

    /// The patch, when all source rows were added.
    pub fn finish(self) -> RasterPatch {
        self.patch
    }
}

impl SourceRows {
    fn blacken_missing(&mut self) {
        if let Some(mask) = &self.mask {
            for (pixel, &seen) in self.rgb.chunks_exact_mut(3).zip(mask) {
                if seen == 0 {
                    pixel.fill(0);
                }
            }
        }
    }
}

impl RowSum {
    fn new(width: usize) -> Self {
        Self {
            colour: vec![0.0; width * 3],
            plain_weight: 0.0,
            masked_weight: Vec::new(),
        }
    }

    fn add(&mut self, source: &SourceRows, row: usize, weight: f32) {
        let width = source.width;
        let rgb = &source.rgb[row * width * 3..(row + 1) * width * 3];
        for (sum, &value) in self.colour.iter_mut().zip(rgb) {
            *sum += weight * f32::from(value);
        }
        match &source.mask {
            None => self.plain_weight += weight,
            Some(mask) => {
                self.masked_weight.resize(width, 0.0);
                let mask = &mask[row * width..(row + 1) * width];
                for (sum, &seen) in self.masked_weight.iter_mut().zip(mask) {
                    *sum += if seen == 0 { 0.0 } else { weight };
                }
            }
        }
    }
}

impl Axis {
    /// Filters a row of sums across and writes its colours, divided by the weight on data.
    fn filter(&self, row: &RowSum, rgb: &mut [u8], valid: &mut [u8]) {
        let pixels = rgb.chunks_exact_mut(3).zip(valid);
        for ((taps, &inside), (pixel, valid)) in self.taps.iter().zip(&self.inside).zip(pixels) {
            if taps.weights.is_empty() {
                continue;
            }
            let from = taps.start - self.source_start;
            let to = from + taps.weights.len();
            let mut weight = row.plain_weight * inside;
            if let Some(masked) = row.masked_weight.get(from..to) {
                weight += taps
                    .weights
                    .iter()
                    .zip(masked)
                    .map(|(w, m)| w * m)
                    .sum::<f32>();
            }
            if weight < MIN_VALID_WEIGHT {
                continue;
            }
            let mut sum = [0.0_f32; 3];
            for (colour, &w) in row.colour[from * 3..to * 3]
                .chunks_exact(3)
                .zip(&taps.weights)
            {
                for c in 0..3 {
                    sum[c] += w * colour[c];
                }
            }
            for c in 0..3 {
                pixel[c] = (sum[c] / weight + 0.5) as u8;
            }
            *valid = 255;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(first_row: usize, values: &[&[u8]], mask: Option<Vec<u8>>) -> SourceRows {
        let width = values[0].len();
        let rgb = values.concat().iter().flat_map(|&v| [v, v, v]).collect();
        SourceRows {
            first_row,
            rows: values.len(),
            width,
            rgb,
            mask,
        }
    }

    #[test]
    fn weights_sum_to_one_and_what_falls_outside_is_missing() {
        let axis = Axis::new(-2.0, 8.0, 4, 6);
        let sums: Vec<f32> = axis.inside.clone();
        assert!(sums[0] < 0.2, "two pixels before the source: {sums:?}");
        assert!((sums[2] - 1.0).abs() < 1e-6, "{sums:?}");
        assert_eq!((axis.source_start, axis.source_end), (0, 6));
    }

    #[test]
    fn same_answer_in_one_piece_or_many() {
        let values: Vec<Vec<u8>> = (0..40)
            .map(|y| (0..30).map(|x| (x * 7 + y * 5) as u8).collect())
            .collect();
        let all: Vec<&[u8]> = values.iter().map(Vec::as_slice).collect();
        let axes = || (Axis::new(0.3, 29.0, 11, 30), Axis::new(0.7, 38.5, 13, 40));
        let whole = {
            let (across, down) = axes();
            let (start, end) = (down.source_start, down.source_end);
            let mut r = Resampler::new(across, down);
            r.add(rows(start, &all[start..end], None));
            r.finish()
        };
        for piece in [1, 3, 7] {
            let (across, down) = axes();
            let (start, end) = (down.source_start, down.source_end);
            let mut r = Resampler::new(across, down);
            let mut y = start;
            while y < end {
                let next = (y + piece).min(end);
                // An all-valid mask must change nothing.
                let mask = (y % 2 == 0).then(|| vec![255; (next - y) * 30]);
                r.add(rows(y, &all[y..next], mask));
                y = next;
            }
            assert_eq!(r.finish(), whole, "pieces of {piece}");
        }
    }

    #[test]
    fn rows_beyond_the_source_take_none_from_those_within() {
        let values: Vec<Vec<u8>> = (0..20).map(|y| vec![10 * y + 5; 6]).collect();
        let all: Vec<&[u8]> = values.iter().map(Vec::as_slice).collect();
        // Output rows of two source rows, from so many before the source to so many after it.
        let resampled = |before: usize, after: usize, piece: usize| {
            let count = before + 10 + after;
            let down = Axis::new(-2.0 * before as f64, 2.0 * count as f64, count, 20);
            assert_eq!((down.source_start, down.source_end), (0, 20));
            let mut r = Resampler::new(Axis::new(0.0, 6.0, 3, 6), down);
            for (i, rows_of_piece) in all.chunks(piece).enumerate() {
                r.add(rows(i * piece, rows_of_piece, None));
            }
            r.finish()
        };
        let within = resampled(0, 0, 20);
        assert!(within.valid.iter().all(|&v| v == 255));
        for (before, after) in [(0, 4), (0, 90), (7, 0), (90, 0), (30, 40)] {
            for piece in [1, 3, 8, 20] {
                let patch = resampled(before, after, piece);
                let row = 3 * before..3 * (before + 10);
                let rgb = &patch.rgb.as_raw()[3 * row.start..3 * row.end];
                let case = format!("{before} rows before, {after} after, pieces of {piece}");
                assert_eq!(rgb, within.rgb.as_raw(), "{case}");
                assert_eq!(&patch.valid.as_raw()[row], within.valid.as_raw(), "{case}");
                let valid = patch.valid.iter().filter(|&&v| v == 255).count();
                assert_eq!(valid, 30, "{case}");
            }
        }
    }

    #[test]
    fn missing_pixels_have_no_part_in_the_average() {
        // Four pixels, the second and fourth missing; two output pixels.
        let mut r = Resampler::new(Axis::new(0.0, 4.0, 2, 4), Axis::new(0.0, 1.0, 1, 1));
        r.add(rows(0, &[&[100, 7, 50, 9]], Some(vec![255, 0, 255, 0])));
        let patch = r.finish();
        assert_eq!(patch.valid.get_pixel(0, 0).0[0], 255);
        // Weights 3/8, 3/8, 1/8 and 1/8 beyond the edge: (3 * 100 + 50) / 4.
        assert_eq!(patch.rgb.get_pixel(0, 0).0, [88, 88, 88]);
    }
}
