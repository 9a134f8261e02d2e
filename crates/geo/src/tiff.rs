//! GeoTIFF and COG as blocks.

use std::path::Path;
use std::sync::OnceLock;

use crate::GeoError;
use crate::block::{Block, BlockLayout, BlockSource, Validity};
use crate::pam::read_pam;
use crate::samples::{SampleKind, Samples, Stretch};
use crate::sidecar_values::SidecarValues;
use crate::tiff_compression::compression_name;
use crate::tiff_images::{TiffImages, open_images};
use crate::tiff_level::{Access, Level};

/// GDAL's tag for the value of pixels without data.
const TAG_GDAL_NODATA: u16 = 42113;
/// Blocks along each side of the grid that is sampled for the stretch.
const STRETCH_GRID: u64 = 8;
/// Pixels of a block that are sampled.
const STRETCH_PIXELS_A_BLOCK: usize = 4096;

/// A map in a TIFF file.
pub(crate) struct TiffMap {
    levels: Vec<Level>,
    layouts: Vec<BlockLayout>,
    nodata: Option<f64>,
    nodata_is_beside: bool,
    pam: SidecarValues,
    stretch: OnceLock<Stretch>,
    images: TiffImages,
}

impl TiffMap {
    /// Opens a file and its sidecars, without decoding pixels.
    pub fn open(path: &Path) -> Result<Self, GeoError> {
        let images = open_images(path)?;
        let levels: Vec<Level> = images
            .levels
            .iter()
            .map(Level::new)
            .collect::<Result<_, _>>()?;
        let layouts = levels.iter().map(Level::layout).collect();
        let own_nodata = levels
            .first()
            .and_then(|level| level.image.ifd.tag(TAG_GDAL_NODATA))
            .and_then(|tag| tag.value.as_str())
            .and_then(|text| text.trim_matches(['\0', ' ']).parse::<f64>().ok());
        let pam = read_pam(path)?;
        let nodata = own_nodata.or(pam.nodata);
        Ok(Self {
            levels,
            layouts,
            nodata,
            nodata_is_beside: own_nodata.is_none() && nodata.is_some(),
            pam,
            stretch: OnceLock::new(),
            images,
        })
    }

    /// The images of the file, for its georeference and hash.
    pub fn images(&self) -> &TiffImages {
        &self.images
    }

    /// Width and height, pixels.
    pub fn size_px(&self) -> (u64, u64) {
        (self.layouts[0].width, self.layouts[0].height)
    }

    /// What GDAL keeps beside the file.
    pub fn pam(&self) -> &SidecarValues {
        &self.pam
    }

    /// The value of pixels without data, if it is one of a file beside the map.
    pub fn nodata_beside(&self) -> Option<f64> {
        self.nodata.filter(|_| self.nodata_is_beside)
    }

    /// Takes this value for that of pixels without data, whatever the files say.
    pub fn set_nodata(&mut self, nodata: f64) {
        self.nodata = Some(nodata);
        self.nodata_is_beside = false;
    }

    /// Whether samples are shown as they are stored.
    pub fn is_8_bit(&self) -> bool {
        self.levels[0].kind == SampleKind::U8
    }

    /// Whether there is one colour band only.
    pub fn is_grey(&self) -> bool {
        self.levels[0].bands.is_grey()
    }

    /// Description of the file for messages.
    pub fn kind(&self) -> String {
        let (level, layout) = (&self.levels[0], self.layouts[0]);
        let ifd = &level.image.ifd;
        let pieces = if ifd.is_tiled() {
            format!("tiles of {} x {}", layout.block_w, layout.block_h)
        } else {
            format!(
                "strips of {} rows",
                u64::from(ifd.rows_per_strip()).min(layout.height)
            )
        };
        let compression = compression_name(ifd.compression());
        let bands = match (level.palette, level.bands.is_grey(), level.bands.count) {
            (true, ..) => "palette".to_string(),
            (_, true, 1) => "grey".to_string(),
            (_, true, n) => format!("{n} bands, the first as grey"),
            (_, false, 3) => "RGB".to_string(),
            (_, false, n) if level.bands.alpha == Some(3) && n == 4 => "RGBA".to_string(),
            (_, false, n) => format!("{n} bands, the first three as RGB"),
        };
        let big = if level.image.file.is_bigtiff() {
            "BigTIFF"
        } else {
            "TIFF"
        };
        let mut text = format!(
            "{big}, {pieces}, {compression}, {} {bands}",
            level.kind.name()
        );
        if let Some(nodata) = self.nodata {
            text.push_str(&format!(", nodata {nodata}"));
        }
        if level.mask.is_some() {
            text.push_str(", mask");
        }
        match (self.levels.len() - 1, self.images.external_overviews) {
            (0, _) => text.push_str(", no overviews"),
            (n, 0) => text.push_str(&format!(", {n} overviews")),
            (n, _) => text.push_str(&format!(", {n} overviews (.ovr)")),
        }
        text
    }

    /// The stretch of samples that are not 8-bit. It depends on the file alone, not on what is
    /// read first.
    fn stretch(&self) -> Result<Stretch, GeoError> {
        if let Some(stretch) = self.stretch.get() {
            return Ok(*stretch);
        }
        if self.levels[0].kind == SampleKind::U8 {
            return Ok(*self.stretch.get_or_init(|| Stretch::IDENTITY));
        }
        // The coarsest level that still has enough pixels.
        let index = (0..self.layouts.len())
            .rev()
            .find(|&i| self.layouts[i].width.min(self.layouts[i].height) >= 256)
            .unwrap_or(0);
        let (level, layout) = (&self.levels[index], self.layouts[index]);
        let picks = |blocks: u64| -> Vec<u64> {
            let n = blocks.min(STRETCH_GRID);
            (0..n).map(|i| (2 * i + 1) * blocks / (2 * n)).collect()
        };
        let columns = picks(layout.width.div_ceil(layout.block_w));
        let rows = picks(layout.height.div_ceil(layout.block_h));
        let zero_is_missing = self.nodata.is_none() && level.kind.is_unsigned();
        let mut samples = [Vec::new(), Vec::new(), Vec::new()];
        for &row in &rows {
            for &column in &columns {
                let Some(piece) = self.read_samples(level, layout, column, row)? else {
                    continue;
                };
                let step = piece.mask.len().div_ceil(STRETCH_PIXELS_A_BLOCK);
                level.samples(&piece.bytes).collect(
                    &piece.mask,
                    step,
                    zero_is_missing,
                    &mut samples,
                );
            }
        }
        let stretch = Stretch::from_samples(samples);
        tracing::debug!(?stretch, "stretch of samples that are not 8-bit");
        Ok(*self.stretch.get_or_init(|| stretch))
    }

    /// Samples of a block and where it has data; `None` if nothing of it was ever written.
    fn read_samples(
        &self,
        level: &Level,
        layout: BlockLayout,
        column: u64,
        row: u64,
    ) -> Result<Option<Piece>, GeoError> {
        let (left, right) = layout.columns_of(column);
        let (top, bottom) = layout.rows_of(row);
        let (w, h) = ((right - left) as usize, (bottom - top) as usize);
        let (x, y) = (left as usize, top as usize);
        let image = &level.image;
        if image.is_unwritten(x, y, w, h) {
            return Ok(None);
        }
        image.check_jpeg(x, y, w, h)?;
        let bytes = match level.access {
            Access::Stored => image
                .file
                .read_window_bytes_from_ifd(&image.ifd, y, x, h, w),
            Access::Converted => image
                .file
                .read_decoded_window_bytes_from_ifd(&image.ifd, y, x, h, w),
            Access::Direct => image.read_direct(level.kind, level.bands.count, x, y, w, h),
        }
        .map_err(|e| image.error(e))?;
        let bytes = level.as_kind(bytes);
        let mut mask = vec![255_u8; w * h];
        image.mark_unwritten(x, y, w, &mut mask);
        if let Some((kind, bands)) = level.nodata_samples.filter(|_| self.nodata.is_some()) {
            let stored = image
                .file
                .read_window_bytes_from_ifd(&image.ifd, y, x, h, w)
                .map_err(|e| image.error(e))?;
            Samples {
                bytes: &stored,
                kind,
                bands,
            }
            .mark_missing(self.nodata, &mut mask);
            level.samples(&bytes).mark_missing(None, &mut mask);
        } else {
            level.samples(&bytes).mark_missing(self.nodata, &mut mask);
        }
        if let Some(stored) = &level.mask {
            let seen = stored
                .file
                .read_window_bytes_from_ifd(&stored.ifd, y, x, h, w)
                .map_err(|e| stored.error(e))?;
            for (m, &s) in mask.iter_mut().zip(&seen) {
                if s == 0 {
                    *m = 0;
                }
            }
        }
        Ok(Some(Piece { bytes, mask }))
    }
}

struct Piece {
    bytes: Vec<u8>,
    mask: Vec<u8>,
}

impl BlockSource for TiffMap {
    fn levels(&self) -> &[BlockLayout] {
        &self.layouts
    }

    fn decode(&self, level: usize, column: u64, row: u64) -> Result<Block, GeoError> {
        let (level, layout) = (&self.levels[level], self.layouts[level]);
        let (left, right) = layout.columns_of(column);
        let width = (right - left) as usize;
        let Some(piece) = self.read_samples(level, layout, column, row)? else {
            return Ok(Block::empty(width));
        };
        let validity = Validity::from_mask(piece.mask);
        if validity == Validity::None {
            return Ok(Block::empty(width));
        }
        let stretch = if level.kind == SampleKind::U8 {
            Stretch::IDENTITY
        } else {
            self.stretch()?
        };
        let rgb = if level.kind == SampleKind::U8
            && level.bands.count == 3
            && !level.bands.is_grey()
            && !level.bands.inverted
        {
            piece.bytes
        } else {
            level.samples(&piece.bytes).to_rgb(&stretch)
        };
        Ok(Block {
            width,
            rgb,
            validity,
        })
    }
}
