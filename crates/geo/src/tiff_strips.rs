//! Strips and tiles as they lie in a TIFF file: reading uncompressed ones without the decoder, and finding those that were never
//! written or are damaged.

use tiff_reader::RasterLayout;

use crate::GeoError;
use crate::picture_block::damage_text;
use crate::samples::SampleKind;
use crate::tiff_images::TiffImage;

/// TIFF 6.0: no compression.
const COMPRESSION_NONE: u16 = 1;
/// TIFF Technical Note 2: JPEG.
const COMPRESSION_JPEG: u16 = 7;
/// TIFF Technical Note 2: quantisation and Huffman tables of all blocks.
const TAG_JPEG_TABLES: u16 = 347;

impl TiffImage {
    /// Whether parts of rows can be read directly from the file: uncompressed strips in the native byte order.
    pub(crate) fn can_read_direct(&self, layout: &RasterLayout) -> bool {
        let native = if cfg!(target_endian = "big") {
            tiff_reader::ByteOrder::BigEndian
        } else {
            tiff_reader::ByteOrder::LittleEndian
        };
        !self.ifd.is_tiled()
            && self.ifd.compression() == COMPRESSION_NONE
            && layout.planar_configuration == 1
            && layout.predictor == 1
            && self.ifd.fill_order() == 1
            && (layout.bytes_per_sample == 1 || self.file.byte_order() == native)
    }

    /// Reads a rectangle of uncompressed strips, row by row, without touching the rest of them.
    pub(crate) fn read_direct(
        &self,
        kind: SampleKind,
        samples: usize,
        x: usize,
        y: usize,
        w: usize,
        h: usize,
    ) -> Result<Vec<u8>, tiff_reader::TiffError> {
        let pixel_bytes = samples * kind.bytes();
        let row_bytes = self.size().0 * pixel_bytes as u64;
        let rows_per_strip = u64::from(self.ifd.rows_per_strip().max(1));
        let mut out = Vec::with_capacity(w * h * pixel_bytes);
        for row in y as u64..(y + h) as u64 {
            let (offset, count) = self.block_place((row / rows_per_strip) as usize, false);
            if offset == 0 || count == 0 {
                out.resize(out.len() + w * pixel_bytes, 0);
                continue;
            }
            let at = offset + (row % rows_per_strip) * row_bytes + (x * pixel_bytes) as u64;
            out.extend_from_slice(&self.file.source().read_exact_at(at, w * pixel_bytes)?);
        }
        Ok(out)
    }

    /// Whether none of the blocks under a rectangle was ever written (sparse files).
    pub(crate) fn is_unwritten(&self, x: usize, y: usize, w: usize, h: usize) -> bool {
        self.blocks_under(x, y, w, h)
            .all(|(offset, count)| offset == 0 || count == 0)
    }

    /// Clears the mask of a rectangle in rows of strips that were never written: a block may hold several strips.
    pub(crate) fn mark_unwritten(&self, x: usize, y: usize, w: usize, mask: &mut [u8]) {
        for (row, seen) in mask.chunks_exact_mut(w).enumerate() {
            if self.is_unwritten(x, y + row, w, 1) {
                seen.fill(0);
            }
        }
    }

    /// Checks the JPEG data of the blocks under a rectangle, if that is how they are compressed: the decoder goes on after damage, with
    /// what follows shifted.
    ///
    /// # Errors
    /// [`GeoError::Damaged`] for the first block that is damaged; what the system says if it cannot be read.
    pub(crate) fn check_jpeg(
        &self,
        x: usize,
        y: usize,
        w: usize,
        h: usize,
    ) -> Result<(), GeoError> {
        if self.ifd.compression() != COMPRESSION_JPEG {
            return Ok(());
        }
        let tables = self.ifd.tag(TAG_JPEG_TABLES);
        let tables = tables.and_then(|tag| tag.value.as_bytes());
        for (offset, count) in self.blocks_under(x, y, w, h) {
            if offset == 0 || count == 0 {
                continue;
            }
            let stream = self
                .file
                .source()
                .read_exact_at(offset, count as usize)
                .map_err(|error| self.error(error))?;
            if let Some(damage) = grimnet_jpeg::check_scans(tables, &stream) {
                let reason = format!("block at byte {offset}: {}", damage_text(damage));
                return Err(GeoError::damaged(&self.path, reason));
            }
        }
        Ok(())
    }

    /// Offset and length of each strip or tile under a rectangle, of all planes.
    fn blocks_under(
        &self,
        x: usize,
        y: usize,
        w: usize,
        h: usize,
    ) -> impl Iterator<Item = (u64, u64)> {
        let tiled = self.ifd.is_tiled();
        let (width, height) = self.size();
        let (bw, bh) = match (self.ifd.tile_width(), self.ifd.tile_height()) {
            (Some(bw), Some(bh)) if tiled => (u64::from(bw.max(1)), u64::from(bh.max(1))),
            _ => (
                width,
                u64::from(self.ifd.rows_per_strip().max(1)).min(height),
            ),
        };
        let planes = if self.ifd.planar_configuration() == 2 {
            u64::from(self.ifd.samples_per_pixel())
        } else {
            1
        };
        let (columns, rows) = (width.div_ceil(bw), height.div_ceil(bh));
        (0..planes).flat_map(move |plane| {
            (y as u64 / bh..=(y + h - 1) as u64 / bh).flat_map(move |row| {
                (x as u64 / bw..=(x + w - 1) as u64 / bw).map(move |column| {
                    let index = (plane * rows + row) * columns + column;
                    self.block_place(index as usize, tiled)
                })
            })
        })
    }

    /// Offset and length of a strip or tile; zeros if there is none.
    fn block_place(&self, index: usize, tiled: bool) -> (u64, u64) {
        use tiff_reader::TagValue;
        // TIFF 6.0: TileOffsets, TileByteCounts, StripOffsets, StripByteCounts.
        let (offsets, counts) = if tiled { (324, 325) } else { (273, 279) };
        let at = |tag: u16| match self.ifd.tag(tag).map(|t| &t.value) {
            Some(TagValue::Byte(v)) => v.get(index).map(|&v| u64::from(v)),
            Some(TagValue::Short(v)) => v.get(index).map(|&v| u64::from(v)),
            Some(TagValue::Long(v)) => v.get(index).map(|&v| u64::from(v)),
            Some(TagValue::Long8(v)) => v.get(index).copied(),
            _ => None,
        };
        (at(offsets).unwrap_or(0), at(counts).unwrap_or(0))
    }
}
