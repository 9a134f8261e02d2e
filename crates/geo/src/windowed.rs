//! Windows of a block source, at any resolution.

use std::sync::Arc;

use grimnet_limits::MapLimits;
use image::{GrayImage, RgbImage};

use crate::block::{Block, BlockLayout, BlockSource, Validity};
use crate::block_cache::BlockCache;
use crate::resample::{Axis, Resampler, SourceRows};
use crate::{GeoError, RasterPatch, WindowPx};

/// Maximum number of pixels of a patch.
const MAX_OUTPUT_PX: u64 = MapLimits::DEFAULT.max_window_px;
/// Longest side of a window, pixels: resampling evaluates the filter over all of it, also outside the map.
const MAX_WINDOW_SIDE_PX: f64 = MapLimits::DEFAULT.max_window_side_px as f64;
/// An overview may be coarser than requested by this factor (rounding of its size).
const OVERVIEW_SLACK: f64 = 1.01;
/// Windows within this distance of whole pixels are copied, pixels.
const WHOLE_PIXEL_TOLERANCE: f64 = 1e-6;
/// Approximate number of source bytes that are filtered at a time.
const BYTES_AT_A_TIME: usize = 4 << 20;
/// The cache grows to this size to hold the blocks that two neighbouring windows share.
const MAX_BUDGET_BYTES: usize = 512 << 20;

/// Reads a window of a source through a cache. Semantics: [`crate::Raster::read`].
pub(crate) fn read_window(
    source: &dyn BlockSource,
    source_id: usize,
    cache: &BlockCache,
    window: WindowPx,
    out_w: u32,
    out_h: u32,
) -> Result<RasterPatch, GeoError> {
    check(window, out_w, out_h)?;
    let levels = source.levels();
    let Some(full) = levels.first() else {
        return Ok(empty_patch(out_w, out_h));
    };
    let scale_x = window.w / f64::from(out_w);
    let scale_y = window.h / f64::from(out_h);
    let reduction = scale_x.min(scale_y);
    let (index, layout) = choose_level(levels, reduction);
    let (factor_x, factor_y) = (
        full.width as f64 / layout.width as f64,
        full.height as f64 / layout.height as f64,
    );
    let window = WindowPx::new(
        window.x / factor_x,
        window.y / factor_y,
        window.w / factor_x,
        window.h / factor_y,
    );
    let reader = Reader {
        source,
        source_id,
        cache,
        level: index,
        layout,
    };
    match whole_pixels(window, out_w, out_h) {
        Some((x, y)) => reader.copy(x, y, out_w, out_h),
        None => reader.resample(window, out_w, out_h),
    }
}

pub(crate) fn check(window: WindowPx, out_w: u32, out_h: u32) -> Result<(), GeoError> {
    let bad = |reason: &str| {
        Err(GeoError::BadWindow {
            window: window.to_string(),
            reason: reason.to_string(),
        })
    };
    let sides = [window.x, window.y, window.w, window.h];
    if sides.iter().any(|v| !v.is_finite() || v.abs() > 1e12) {
        return bad("its position and size must be finite and below 1e12 pixels");
    }
    if window.w.max(window.h) > MAX_WINDOW_SIDE_PX {
        return bad(&format!(
            "it is {} pixels long, more than {MAX_WINDOW_SIDE_PX}; choose a finer ground resolution",
            window.w.max(window.h)
        ));
    }
    if window.w <= 0.0 || window.h <= 0.0 {
        return bad("it is empty");
    }
    if out_w == 0 || out_h == 0 || u64::from(out_w) * u64::from(out_h) > MAX_OUTPUT_PX {
        return bad("the output must have 1 to 2^28 pixels");
    }
    Ok(())
}

pub(crate) fn empty_patch(out_w: u32, out_h: u32) -> RasterPatch {
    RasterPatch {
        rgb: RgbImage::new(out_w, out_h),
        valid: GrayImage::new(out_w, out_h),
    }
}

/// The coarsest level that is not coarser than the requested reduction.
fn choose_level(levels: &[BlockLayout], reduction: f64) -> (usize, BlockLayout) {
    let full = levels[0];
    let mut best = (0, full);
    for (index, level) in levels.iter().enumerate() {
        let factor =
            (full.width as f64 / level.width as f64).max(full.height as f64 / level.height as f64);
        if factor <= reduction * OVERVIEW_SLACK && level.width < best.1.width {
            best = (index, *level);
        }
    }
    best
}

/// The top-left pixel, if output pixels are source pixels.
fn whole_pixels(window: WindowPx, out_w: u32, out_h: u32) -> Option<(i64, i64)> {
    let near = |a: f64, b: f64| (a - b).abs() < WHOLE_PIXEL_TOLERANCE;
    let whole = near(window.w, f64::from(out_w))
        && near(window.h, f64::from(out_h))
        && near(window.x, window.x.round())
        && near(window.y, window.y.round());
    whole.then(|| (window.x.round() as i64, window.y.round() as i64))
}

struct Reader<'a> {
    source: &'a dyn BlockSource,
    source_id: usize,
    cache: &'a BlockCache,
    level: usize,
    layout: BlockLayout,
}

impl Reader<'_> {
    fn copy(&self, x: i64, y: i64, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        let mut patch = empty_patch(out_w, out_h);
        let columns = clip(x, out_w, self.layout.width);
        let rows = clip(y, out_h, self.layout.height);
        if columns.0 >= columns.1 || rows.0 >= rows.1 {
            return Ok(patch);
        }
        self.make_room(columns, rows);
        let (rgb, valid): (&mut [u8], &mut [u8]) = (&mut patch.rgb, &mut patch.valid);
        let out_w = out_w as usize;
        for block_row in rows.0 / self.layout.block_h..=(rows.1 - 1) / self.layout.block_h {
            let (top, bottom) = self.layout.rows_of(block_row);
            let (from_y, to_y) = (rows.0.max(top), rows.1.min(bottom));
            self.for_blocks(columns, block_row, |block, left, from_x, to_x| {
                let (offset, count) = ((from_x - left) as usize, (to_x - from_x) as usize);
                let out_x = (from_x as i64 - x) as usize;
                for row in from_y..to_y {
                    let from = (row - top) as usize * block.width + offset;
                    let to = (row as i64 - y) as usize * out_w + out_x;
                    copy_row(block, from, count, rgb, Some(valid), to);
                }
            })?;
        }
        // Pixels without data are black.
        for (pixel, seen) in rgb.chunks_exact_mut(3).zip(valid.iter()) {
            if *seen == 0 {
                pixel.fill(0);
            }
        }
        Ok(patch)
    }

    fn resample(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        let across = Axis::new(
            window.x,
            window.w,
            out_w as usize,
            self.layout.width as usize,
        );
        let down = Axis::new(
            window.y,
            window.h,
            out_h as usize,
            self.layout.height as usize,
        );
        if across.is_empty() || down.is_empty() {
            return Ok(empty_patch(out_w, out_h));
        }
        let columns = (across.source_start as u64, across.source_end as u64);
        let rows = (down.source_start as u64, down.source_end as u64);
        self.make_room(columns, rows);
        let width = (columns.1 - columns.0) as usize;
        let mut resampler = Resampler::new(across, down);
        for block_row in rows.0 / self.layout.block_h..=(rows.1 - 1) / self.layout.block_h {
            let (top, bottom) = self.layout.rows_of(block_row);
            let (from_y, to_y) = (rows.0.max(top), rows.1.min(bottom));
            let blocks = self.blocks(columns, block_row)?;
            let all_valid = blocks.iter().all(|b| b.validity == Validity::All);
            let rows_at_a_time = (BYTES_AT_A_TIME / (width * 3)).max(16);
            let mut y = from_y;
            while y < to_y {
                let count = rows_at_a_time.min((to_y - y) as usize);
                let mut rgb = vec![0_u8; count * width * 3];
                let mut mask = (!all_valid).then(|| vec![0_u8; count * width]);
                for (i, block) in blocks.iter().enumerate() {
                    let column = columns.0 / self.layout.block_w + i as u64;
                    let (left, right) = self.layout.columns_of(column);
                    let (from_x, to_x) = (columns.0.max(left), columns.1.min(right));
                    for row in 0..count {
                        let from = (y - top) as usize * block.width
                            + row * block.width
                            + (from_x - left) as usize;
                        let to = row * width + (from_x - columns.0) as usize;
                        let count = (to_x - from_x) as usize;
                        copy_row(block, from, count, &mut rgb, mask.as_deref_mut(), to);
                    }
                }
                resampler.add(SourceRows {
                    first_row: y as usize,
                    rows: count,
                    width,
                    rgb,
                    mask,
                });
                y += count as u64;
            }
        }
        Ok(resampler.finish())
    }

    /// Calls `use_block(block, left, from_x, to_x)` for each block of a row that meets columns.
    fn for_blocks(
        &self,
        columns: (u64, u64),
        block_row: u64,
        mut use_block: impl FnMut(&Block, u64, u64, u64),
    ) -> Result<(), GeoError> {
        let first = columns.0 / self.layout.block_w;
        for (i, block) in self.blocks(columns, block_row)?.iter().enumerate() {
            let (left, right) = self.layout.columns_of(first + i as u64);
            use_block(block, left, columns.0.max(left), columns.1.min(right));
        }
        Ok(())
    }

    fn blocks(&self, columns: (u64, u64), block_row: u64) -> Result<Vec<Arc<Block>>, GeoError> {
        let block_columns = (
            columns.0 / self.layout.block_w,
            (columns.1 - 1) / self.layout.block_w + 1,
        );
        self.cache.row_of_blocks(
            self.source,
            self.source_id,
            self.level,
            block_columns,
            block_row,
        )
    }

    /// Lets the cache hold this window's blocks, so that the next window of a sweep finds those
    /// they share. Blocks as wide as the map (bands of strips) are all shared.
    fn make_room(&self, columns: (u64, u64), rows: (u64, u64)) {
        let blocks = |range: (u64, u64), side: u64| (range.1 - 1) / side - range.0 / side + 1;
        let count = blocks(columns, self.layout.block_w) * (blocks(rows, self.layout.block_h) + 1);
        let pixels = count
            .saturating_mul(self.layout.block_w.min(self.layout.width))
            .saturating_mul(self.layout.block_h.min(self.layout.height));
        let bytes = usize::try_from(pixels.saturating_mul(3)).unwrap_or(usize::MAX);
        self.cache.ensure_budget(bytes.min(MAX_BUDGET_BYTES));
    }
}

/// `[start, start + length)` within `[0, side)`.
fn clip(start: i64, length: u32, side: u64) -> (u64, u64) {
    let end = start + i64::from(length);
    (start.max(0) as u64, (end.max(0) as u64).min(side))
}

/// Copies pixels of a block, `from` and `to` counted in pixels.
fn copy_row(
    block: &Block,
    from: usize,
    count: usize,
    rgb: &mut [u8],
    mask: Option<&mut [u8]>,
    to: usize,
) {
    if block.validity == Validity::None {
        return;
    }
    rgb[to * 3..(to + count) * 3].copy_from_slice(&block.rgb[from * 3..(from + count) * 3]);
    if let Some(mask) = mask {
        match &block.validity {
            Validity::All => mask[to..to + count].fill(255),
            Validity::Mask(seen) => {
                mask[to..to + count].copy_from_slice(&seen[from..from + count]);
            }
            Validity::None => {}
        }
    }
}
