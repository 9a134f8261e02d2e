//! Tiles of the Web Mercator grid as one map: the finest zoom, or a chosen one, with the coarser ones as its overviews.

use std::f64::consts::PI;
use std::io::Cursor;

use grimnet_limits::MapLimits;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::block::{Block, BlockLayout, BlockSource};
use crate::block_canvas::{BlockCanvas, Part};
use crate::flipped_rows::rows_look_flipped;
use crate::metres::WGS84_A_M;
use crate::picture_block::{block_of_picture, decode_jpeg};
use crate::tile_address::TileAddress;
use crate::tile_index::TileRange;
use crate::tile_store::TileStore;
use crate::{Affine, Crs, GeoError, Georeference};

/// EPSG:3857: half the side of the square that zoom 0 covers, metres of Mercator (not of the ground).
const HALF_WORLD: f64 = PI * WGS84_A_M;
/// Largest side of a tile, pixels.
const MAX_TILE_SIDE_PX: u32 = MapLimits::DEFAULT.max_tile_side_px;
/// Smallest side of a tile, pixels.
const MIN_TILE_SIDE_PX: u32 = 64;
/// Coarser zooms that are compared with the finest one.
const ZOOMS_COMPARED: u8 = 4;
/// Fewer tiles say nothing about what a zoom covers.
const MIN_TILES_COMPARED: usize = 16;
/// A zoom that refines less than this share of a coarser one covers a part of the map only.
const MIN_SHARE_REFINED: f64 = 0.5;

/// A map of tiles.
pub(crate) struct TileMap {
    store: Box<dyn TileStore>,
    /// Zoom of the finest level; each further level is one zoom coarser.
    zoom: u8,
    tile_px: u64,
    /// Left and top edge of the map at its finest level, pixels of the world at that zoom.
    origin_px: (u64, u64),
    layouts: Vec<BlockLayout>,
    range: TileRange,
}

impl TileMap {
    /// A map of the tiles of `zoom`, the finest one by default.
    pub fn new(store: Box<dyn TileStore>, zoom: Option<u8>) -> Result<Self, GeoError> {
        let index = store.index();
        let zoom = choose_zoom(store.as_ref(), zoom)?;
        let no_tiles = || not_a_map(store.as_ref(), "it has no tiles");
        let range = index.range(zoom).ok_or_else(no_tiles)?;
        check_rows(store.as_ref())?;
        let &(column, row) = index.of_zoom(zoom).first().ok_or_else(no_tiles)?;
        let first = TileAddress { zoom, column, row };
        let tile_px = u64::from(side_of(store.as_ref(), first)?);
        let side = |first: u32, last: u32| (u64::from(last - first) + 1) * tile_px;
        let (width, height) = (
            side(range.first_column, range.last_column),
            side(range.first_row, range.last_row),
        );
        // Halving keeps the map's corner on whole pixels as often as the side of a tile can be halved.
        let mut layouts = Vec::new();
        for level in 0..=tile_px.trailing_zeros().min(u32::from(zoom)) as u8 {
            if level > 0 && !index.zoom_above_covers(zoom - level + 1) {
                break;
            }
            layouts.push(BlockLayout {
                width: width >> level,
                height: height >> level,
                block_w: tile_px,
                block_h: tile_px,
            });
        }
        let origin_px = (
            u64::from(range.first_column) * tile_px,
            u64::from(range.first_row) * tile_px,
        );
        Ok(Self {
            store,
            zoom,
            tile_px,
            origin_px,
            layouts,
            range,
        })
    }

    /// Where the tiles come from.
    pub fn store(&self) -> &dyn TileStore {
        self.store.as_ref()
    }

    /// Where the map lies: EPSG:3857.
    pub fn georeference(&self) -> Result<Georeference, GeoError> {
        let size = 2.0 * HALF_WORLD / (self.tile_px << self.zoom) as f64;
        let affine = Affine::from_gdal([
            self.origin_px.0 as f64 * size - HALF_WORLD,
            size,
            0.0,
            HALF_WORLD - self.origin_px.1 as f64 * size,
            0.0,
            -size,
        ])?;
        let full = self.layouts[0];
        let crs = Crs::from_epsg(3857)?;
        Ok(Georeference::new(affine, crs, (full.width, full.height)))
    }

    /// The zooms that are read, finest first.
    pub fn zooms(&self) -> Vec<u8> {
        (0..self.layouts.len() as u8)
            .map(|level| self.zoom - level)
            .collect()
    }

    /// BLAKE3 of all that the map's pixels are made of.
    pub fn hash(&self) -> Result<[u8; 32], GeoError> {
        let mut hasher = blake3::Hasher::new();
        self.store.hash(&self.zooms(), &mut hasher)?;
        if self.store.index().zooms().next_back() != Some(self.zoom) {
            // Another zoom has other pixels.
            hasher.update(b"zoom");
            hasher.update(&[self.zoom]);
        }
        Ok(hasher.finalize().into())
    }

    /// Description for messages.
    pub fn kind(&self) -> String {
        let tiles = self.store.index().of_zoom(self.zoom).len();
        let grid = u64::from(self.range.last_column - self.range.first_column + 1)
            * u64::from(self.range.last_row - self.range.first_row + 1);
        let missing = match grid.saturating_sub(tiles as u64) {
            0 => String::new(),
            n => format!(", {n} missing"),
        };
        format!(
            "{}, zoom {}, {tiles} tiles of {side} x {side}{missing}, {} overviews",
            self.store.kind(),
            self.zoom,
            self.layouts.len() - 1,
            side = self.tile_px
        )
    }

    /// What may be wrong with the map.
    pub fn caveats(&self) -> Vec<String> {
        let index = self.store.index();
        let mut caveats = Vec::new();
        for coarser in (self.zoom.saturating_sub(ZOOMS_COMPARED)..self.zoom).rev() {
            let share = index.share_refined(coarser, self.zoom);
            if index.of_zoom(coarser).len() >= MIN_TILES_COMPARED && share < MIN_SHARE_REFINED {
                caveats.push(format!(
                    "zoom {} covers only {:.0} % of what zoom {coarser} covers; choose zoom {coarser} for all of it",
                    self.zoom,
                    100.0 * share
                ));
                break;
            }
        }
        caveats.extend(self.store.caveats());
        caveats
    }

    fn decode_tile(&self, address: TileAddress) -> Result<Option<Block>, GeoError> {
        let Some(bytes) = self.store.tile(address)? else {
            return Ok(None);
        };
        let picture = decode(self.store.as_ref(), address, bytes)?;
        let side = u64::from(picture.width());
        if side != self.tile_px || picture.width() != picture.height() {
            return Err(self.store.damaged(
                address,
                &format!(
                    "{} x {} pixels, where others have {px} x {px}",
                    picture.width(),
                    picture.height(),
                    px = self.tile_px
                ),
            ));
        }
        Ok(Some(block_of_picture(picture)))
    }
}

impl BlockSource for TileMap {
    fn levels(&self) -> &[BlockLayout] {
        &self.layouts
    }

    fn decode(&self, level: usize, column: u64, row: u64) -> Result<Block, GeoError> {
        let layout = self.layouts[level];
        let zoom = self.zoom - level as u8;
        let ((left, right), (top, bottom)) = (layout.columns_of(column), layout.rows_of(row));
        // In pixels of the world at this zoom.
        let (x, y) = (self.origin_px.0 >> level, self.origin_px.1 >> level);
        let (left, right, top, bottom) = (left + x, right + x, top + y, bottom + y);
        let (width, height) = ((right - left) as usize, (bottom - top) as usize);
        let px = self.tile_px;
        let mut canvas = BlockCanvas::new(width, height);
        for tile_row in top / px..=(bottom - 1) / px {
            for tile_column in left / px..=(right - 1) / px {
                let address = TileAddress {
                    zoom,
                    // East of the antimeridian, columns begin at 0.
                    column: (tile_column % (1 << zoom)) as u32,
                    row: tile_row as u32,
                };
                let Some(tile) = self.decode_tile(address)? else {
                    continue;
                };
                let (tile_left, tile_top) = (tile_column * px, tile_row * px);
                let from = (left.max(tile_left), top.max(tile_top));
                let to = (right.min(tile_left + px), bottom.min(tile_top + px));
                if (to.0 - from.0, to.1 - from.1) == (px, px)
                    && (width, height) == (px as usize, px as usize)
                {
                    return Ok(tile);
                }
                let part = Part {
                    from: ((from.0 - tile_left) as usize, (from.1 - tile_top) as usize),
                    to: ((from.0 - left) as usize, (from.1 - top) as usize),
                    size: ((to.0 - from.0) as usize, (to.1 - from.1) as usize),
                };
                canvas.paint(&tile, part);
            }
        }
        Ok(canvas.finish())
    }
}

fn not_a_map(store: &dyn TileStore, reason: &str) -> GeoError {
    GeoError::NotAMap {
        path: store.path().to_path_buf(),
        reason: reason.to_string(),
    }
}

/// Refuses tiles that the stated bounds put on the other side of the equator.
fn check_rows(store: &dyn TileStore) -> Result<(), GeoError> {
    let bounds = store.stated_bounds_deg();
    match bounds.and_then(|bounds_deg| rows_look_flipped(store.index(), bounds_deg)) {
        None => Ok(()),
        Some(what) => Err(GeoError::Unsupported {
            path: store.path().to_path_buf(),
            what,
            advice: store.advice_on_flipped_rows(),
        }),
    }
}

/// The zoom asked for if the store has it, else the finest.
fn choose_zoom(store: &dyn TileStore, zoom: Option<u8>) -> Result<u8, GeoError> {
    let zooms: Vec<u8> = store.index().zooms().collect();
    match (zooms.last(), zoom) {
        (None, _) => Err(not_a_map(store, "it has no tiles")),
        (Some(&finest), None) => Ok(finest),
        (Some(_), Some(zoom)) if zooms.contains(&zoom) => Ok(zoom),
        (Some(_), Some(zoom)) => Err(GeoError::NoSuchZoom {
            path: store.path().to_path_buf(),
            zoom,
            zooms,
        }),
    }
}

/// Side of the tiles, pixels, from the header of one.
fn side_of(store: &dyn TileStore, address: TileAddress) -> Result<u32, GeoError> {
    let bytes = store
        .tile(address)?
        .ok_or_else(|| store.damaged(address, "it is listed and not there"))?;
    let format = picture_format(store, address, &bytes)?;
    let (width, height) = ImageReader::with_format(Cursor::new(bytes), format)
        .into_dimensions()
        .map_err(|e| store.damaged(address, &e.to_string()))?;
    let fits = width == height
        && width.is_power_of_two()
        && (MIN_TILE_SIDE_PX..=MAX_TILE_SIDE_PX).contains(&width);
    if fits {
        return Ok(width);
    }
    Err(GeoError::Unsupported {
        path: store.path().to_path_buf(),
        what: format!("tiles of {width} x {height} pixels (tile {address})"),
        advice: "expected squares of 256 or 512 pixels (a power of two from 64 to 4096): make the tiles again, such as with \
                 gdal2tiles --xyz --tilesize=256",
    })
}

fn picture_format(
    store: &dyn TileStore,
    address: TileAddress,
    bytes: &[u8],
) -> Result<ImageFormat, GeoError> {
    match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => Ok(format),
        Ok(other) => Err(store.damaged(address, &format!("{other:?} tiles are not supported"))),
        Err(_) if bytes.is_empty() => Err(store.damaged(
            address,
            "it is empty; where there is no picture there must be no tile",
        )),
        Err(_) => Err(store.damaged(
            address,
            "it is not a PNG, JPEG or WebP picture (vector tiles, or an error page that was saved as a tile?)",
        )),
    }
}

fn decode(
    store: &dyn TileStore,
    address: TileAddress,
    bytes: Vec<u8>,
) -> Result<DynamicImage, GeoError> {
    let format = picture_format(store, address, &bytes)?;
    let check_size = |(width, height): (u32, u32)| {
        if width.max(height) > MAX_TILE_SIDE_PX {
            return Err(format!("{width} x {height} pixels"));
        }
        Ok(())
    };
    if format == ImageFormat::Jpeg {
        return decode_jpeg(&bytes, check_size).map_err(|reason| store.damaged(address, &reason));
    }
    let damaged = |e: image::ImageError| store.damaged(address, &e.to_string());
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // 16-bit RGBA, and as much again for the decoder.
    let mut limits = Limits::default();
    limits.max_alloc = Some(u64::from(MAX_TILE_SIDE_PX).pow(2) * 16);
    limits.max_image_width = Some(MAX_TILE_SIDE_PX);
    limits.max_image_height = Some(MAX_TILE_SIDE_PX);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(damaged)?;
    check_size(decoder.dimensions()).map_err(|reason| store.damaged(address, &reason))?;
    DynamicImage::from_decoder(decoder).map_err(damaged)
}
