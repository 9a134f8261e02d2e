//! Several pictures as one map; where they overlap, the later one lies above.

use crate::GeoError;
use crate::WindowPx;
use crate::block::{Block, BlockLayout, BlockSource, Validity};
use crate::block_cache::BlockCache;
use crate::block_canvas::{BlockCanvas, Part};
use crate::source_file::SourceFile;
use crate::windowed::read_window;

/// Side of the blocks of the mosaic, pixels.
const BLOCK_PX: u64 = 512;
/// Cache of the pictures' own blocks, bytes; the finished ones are cached elsewhere.
const CACHE_BYTES: usize = 64 << 20;
/// Halvings of the mosaic, at most.
const MAX_OVERVIEWS: u32 = 10;
/// No overview is smaller, pixels.
const MIN_OVERVIEW_PX: u64 = 256;

/// A picture and its place.
pub(crate) struct Member {
    pub file: SourceFile,
    /// The part of the picture that is shown, pixels of the picture.
    pub from: WindowPx,
    /// Where it is shown, pixels of the mosaic.
    pub to: WindowPx,
}

/// Several pictures as one.
pub(crate) struct Mosaic {
    /// Lowest first.
    members: Vec<Member>,
    layouts: Vec<BlockLayout>,
    cache: BlockCache,
}

impl Mosaic {
    /// A mosaic of `size_px`.
    pub fn new(members: Vec<Member>, size_px: (u64, u64)) -> Self {
        let halvings = (0..=MAX_OVERVIEWS).take_while(|&n| {
            let large_enough = (size_px.0.min(size_px.1) >> n) >= MIN_OVERVIEW_PX;
            n == 0 || (large_enough && can_be_halved(&members, size_px, n))
        });
        let layouts = halvings
            .map(|n| BlockLayout {
                width: size_px.0 >> n,
                height: size_px.1 >> n,
                block_w: BLOCK_PX,
                block_h: BLOCK_PX,
            })
            .collect();
        Self {
            members,
            layouts,
            cache: BlockCache::new(CACHE_BYTES),
        }
    }
}

/// Whether the edges of the mosaic and of its pictures lie between pixels after `n` halvings: else pixels at the seams would
/// belong to no picture with half of their weight.
fn can_be_halved(members: &[Member], size_px: (u64, u64), n: u32) -> bool {
    let step = f64::from(1_u32 << n);
    let fits = |v: f64| v % step == 0.0;
    fits(size_px.0 as f64)
        && fits(size_px.1 as f64)
        && members.iter().all(|m| {
            (m.from.w, m.from.h) == (m.to.w, m.to.h)
                && [m.to.x, m.to.y, m.to.w, m.to.h].into_iter().all(fits)
        })
}

impl BlockSource for Mosaic {
    fn levels(&self) -> &[BlockLayout] {
        &self.layouts
    }

    fn decode(&self, level: usize, column: u64, row: u64) -> Result<Block, GeoError> {
        let layout = self.layouts[level];
        let scale = f64::from(1_u32 << level);
        let (columns, rows) = (layout.columns_of(column), layout.rows_of(row));
        let width = (columns.1 - columns.0) as usize;
        let mut canvas = BlockCanvas::new(width, (rows.1 - rows.0) as usize);
        for (id, member) in self.members.iter().enumerate() {
            let across = pixels_between(columns, member.to.x / scale, member.to.w / scale);
            let down = pixels_between(rows, member.to.y / scale, member.to.h / scale);
            let (Some(across), Some(down)) = (across, down) else {
                continue;
            };
            let (w, h) = ((across.1 - across.0) as u32, (down.1 - down.0) as u32);
            // Pixels of the picture per pixel of the mosaic.
            let (per_x, per_y) = (member.from.w / member.to.w, member.from.h / member.to.h);
            let window = WindowPx::new(
                member.from.x + (across.0 as f64 * scale - member.to.x) * per_x,
                member.from.y + (down.0 as f64 * scale - member.to.y) * per_y,
                f64::from(w) * scale * per_x,
                f64::from(h) * scale * per_y,
            );
            let patch = read_window(&member.file, id, &self.cache, window, w, h)?;
            let piece = Block {
                width: w as usize,
                rgb: patch.rgb.into_raw(),
                validity: Validity::Mask(patch.valid.into_raw()),
            };
            let part = Part {
                from: (0, 0),
                to: ((across.0 - columns.0) as usize, (down.0 - rows.0) as usize),
                size: (w as usize, h as usize),
            };
            canvas.paint(&piece, part);
        }
        Ok(canvas.finish())
    }
}

/// Pixels `[start, end)` of a block whose centres lie between `from` and `from + length`.
fn pixels_between(block: (u64, u64), from: f64, length: f64) -> Option<(u64, u64)> {
    let first = (from - 0.5).ceil().max(block.0 as f64);
    let end = (from + length - 0.5).ceil().min(block.1 as f64);
    (first < end).then_some((first as u64, end as u64))
}
