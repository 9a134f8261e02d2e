//! The pixels of a reduced picture, from the samples of its MCUs.

use image::RgbImage;
use rayon::prelude::*;

use crate::block::check_dc;
use crate::damage::Checked;
use crate::reduced::join::{JoinedScan, Run};
use crate::reduced::layout::{Component, Layout};

/// Samples of 8 bits are coded as differences from 128 (T.81, A.3.1); with half a unit for rounding, in units of 1/16.
const LEVEL_SHIFT: i16 = 128 * 16 + 8;

/// The picture of this size, px, from all MCUs of a scan.
pub(crate) fn picture(
    layout: &Layout<'_>,
    scan: &JoinedScan<'_>,
    (width_px, height_px): (u32, u32),
) -> Checked<RgbImage> {
    let mut image = RgbImage::new(width_px, height_px);
    let (mcu_width, mcu_height) = layout.mcu_px();
    let row_bytes = 3 * width_px as usize;
    let stride = layout.mcus_in_row * mcu_width;
    let plane = stride * mcu_height;
    image
        .par_chunks_mut((row_bytes * mcu_height).max(1))
        .enumerate()
        .with_min_len(4)
        .try_for_each_init(
            || vec![0u8; plane * layout.components.len()],
            |samples, (row, out)| {
                for (first_mcu, run, count) in runs_of_row(layout, scan, row) {
                    for index in 0..count {
                        let x = (first_mcu + index) % layout.mcus_in_row * mcu_width;
                        let mcu = run.from + (first_mcu - run.first_mcu) + index;
                        place_mcu(layout, scan, run, mcu, samples, (x, stride))?;
                    }
                }
                let (luma, chroma) = samples.split_at(plane);
                let (blue, red) = chroma.split_at(chroma.len() / 2);
                for (y, out) in out.chunks_exact_mut(row_bytes).enumerate() {
                    let line = y * stride..y * stride + width_px as usize;
                    let (out, _) = out.as_chunks_mut::<3>();
                    if chroma.is_empty() {
                        for (out, &grey) in out.iter_mut().zip(&luma[line]) {
                            *out = [grey; 3];
                        }
                    } else {
                        let lines = (&luma[line.clone()], &blue[line.clone()], &red[line]);
                        convert_line(lines, out);
                    }
                }
                Ok(())
            },
        )?;
    Ok(image)
}

/// The MCUs of a row of them: the index of the first in the picture, the run that holds it, and how many follow.
fn runs_of_row<'s>(
    layout: &Layout<'_>,
    scan: &'s JoinedScan<'_>,
    row: usize,
) -> impl Iterator<Item = (usize, &'s Run, usize)> {
    let begin = row * layout.mcus_in_row;
    let end = begin + layout.mcus_in_row;
    let first = scan
        .runs
        .partition_point(|run| run.first_mcu + run.count <= begin);
    scan.runs[first..]
        .iter()
        .take_while(move |run| run.first_mcu < end)
        .map(move |run| {
            let first = run.first_mcu.max(begin);
            (first, run, (run.first_mcu + run.count).min(end) - first)
        })
}

/// Writes the samples of an MCU into the planes of its row, from the column `x` on.
fn place_mcu(
    layout: &Layout<'_>,
    scan: &JoinedScan<'_>,
    run: &Run,
    mcu: usize,
    planes: &mut [u8],
    (x, stride): (usize, usize),
) -> Checked<()> {
    let data = &scan.parts[run.part].data;
    let mut samples = &data.samples[mcu * layout.samples_of_mcu..];
    let mut dcs = &data.dcs[mcu * layout.blocks_of_mcu..];
    let plane = planes.len() / layout.components.len().max(1);
    let planes = planes.chunks_exact_mut(plane.max(1));
    for ((component, plane), offset) in layout.components.iter().zip(planes).zip(run.dc_offset) {
        let (width, height) = component.basis.size;
        for block in 0..component.blocks.0 * component.blocks.1 {
            let (column, row) = (block % component.blocks.0, block / component.blocks.0);
            let (dc, rest) = dcs.split_first().unwrap_or((&0, &[]));
            let dc = dc.wrapping_add(offset);
            check_dc(dc, component.dc_step)?;
            dcs = rest;
            let (of_block, rest) = samples.split_at(component.basis.samples());
            samples = rest;
            let at = row * height * stride + x + column * width;
            place_block(component, dc, of_block, &mut plane[at..], stride);
        }
    }
    Ok(())
}

#[inline(always)]
fn place_block(
    component: &Component<'_>,
    dc: i32,
    samples: &[i16],
    plane: &mut [u8],
    stride: usize,
) {
    // An eighth of the dequantised coefficient is the block's mean.
    let mean = (2 * dc.wrapping_mul(component.dc_step)) as i16;
    let level = mean.saturating_add(LEVEL_SHIFT);
    let byte = |sample: i16| (sample.saturating_add(level) >> 4).clamp(0, 255) as u8;
    let copy = |line: &mut [u8], samples: &[i16]| {
        for (out, &sample) in line.iter_mut().zip(samples) {
            *out = byte(sample);
        }
    };
    let lines = plane.chunks_mut(stride);
    match component.basis.size.0 {
        8 => lines
            .zip(samples.as_chunks::<8>().0)
            .for_each(|(line, samples)| copy(line, samples)),
        4 => lines
            .zip(samples.as_chunks::<4>().0)
            .for_each(|(line, samples)| copy(line, samples)),
        2 => lines
            .zip(samples.as_chunks::<2>().0)
            .for_each(|(line, samples)| copy(line, samples)),
        _ => lines
            .zip(samples.as_chunks::<1>().0)
            .for_each(|(line, samples)| copy(line, samples)),
    }
}

/// RGB from luminance and chrominance (ITU-T T.871, JFIF), in units of 2^-16.
fn convert_line((luma, blue, red): (&[u8], &[u8], &[u8]), out: &mut [[u8; 3]]) {
    const HALF: i32 = 1 << 15;
    for (((out, &y), &cb), &cr) in out.iter_mut().zip(luma).zip(blue).zip(red) {
        let y = (i32::from(y) << 16) + HALF;
        let (cb, cr) = (i32::from(cb) - 128, i32::from(cr) - 128);
        let byte = |sample: i32| (sample >> 16).clamp(0, 255) as u8;
        *out = [
            byte(y + 91_881 * cr),
            byte(y - 22_554 * cb - 46_802 * cr),
            byte(y + 116_130 * cb),
        ];
    }
}
