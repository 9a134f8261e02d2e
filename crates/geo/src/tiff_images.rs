//! The images in a TIFF file: the map, its overviews, and their masks.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use grimnet_limits::MapLimits;
use tiff_reader::{ByteOrder, Ifd, OpenOptions, TagType, TiffError, TiffFile};

use crate::GeoError;
use crate::error::{ADVICE_SAMPLES, ADVICE_TILE_IT};

/// TIFF 6.0, NewSubfileType.
const TAG_NEW_SUBFILE_TYPE: u16 = 254;
/// TIFF 6.0, SubfileType (old).
const TAG_SUBFILE_TYPE: u16 = 255;
/// TIFF Technical Note 1: SubIFDs, and the type that libtiff gives them, 32 bits.
const TAG_SUB_IFDS: u16 = 330;
const TYPE_IFD: u16 = 13;
const SUBFILE_REDUCED: u64 = 1;
const SUBFILE_MASK: u64 = 4;
/// TIFF 6.0: PhotometricInterpretation of a mask.
const PHOTOMETRIC_MASK: u16 = 4;
/// Largest strip or tile that is decoded, bytes.
const MAX_BLOCK_BYTES: usize = MapLimits::DEFAULT.max_block_bytes as usize;
/// Overviews whose factors along x and y differ by more than this are some other picture.
const MAX_ASPECT_CHANGE: f64 = 0.05;

/// An image of a TIFF file.
#[derive(Clone)]
pub(crate) struct TiffImage {
    pub file: Arc<TiffFile>,
    pub ifd: Arc<Ifd>,
    /// The file, for errors.
    pub path: Arc<PathBuf>,
}

impl TiffImage {
    pub fn size(&self) -> (u64, u64) {
        (u64::from(self.ifd.width()), u64::from(self.ifd.height()))
    }

    /// What a decoder's error means for the user.
    pub fn error(&self, error: TiffError) -> GeoError {
        tiff_error(&self.path, error)
    }
}

/// One resolution of a map.
pub(crate) struct TiffLevel {
    pub image: TiffImage,
    pub mask: Option<TiffImage>,
}

/// All resolutions of a map, finest first, and the files they are in.
pub(crate) struct TiffImages {
    pub levels: Vec<TiffLevel>,
    pub files: Vec<PathBuf>,
    /// How many overviews lie in an `.ovr` file.
    pub external_overviews: usize,
}

/// Opens a TIFF file, with its external overviews (`.ovr`) and mask (`.msk`).
pub(crate) fn open_images(path: &Path) -> Result<TiffImages, GeoError> {
    let main = all_images(path)?;
    let mut files = vec![path.to_path_buf()];
    let base = main
        .iter()
        .find(|image| !is_mask(image) && !is_reduced(image))
        .or_else(|| main.iter().find(|image| !is_mask(image)))
        .cloned()
        .ok_or_else(|| GeoError::NotAMap {
            path: path.to_path_buf(),
            reason: "the TIFF file contains no picture".to_string(),
        })?;
    let mut overviews: Vec<TiffImage> = main
        .iter()
        .filter(|image| is_overview(&base, image))
        .cloned()
        .collect();
    let mut masks: Vec<TiffImage> = main
        .iter()
        .filter(|image| is_mask(image))
        .cloned()
        .collect();
    for ending in ["ovr", "msk", "msk.ovr"] {
        let Some(sidecar) = sidecar(path, ending) else {
            continue;
        };
        let images = all_images(&sidecar)?;
        for image in images {
            if ending != "ovr" || is_mask(&image) {
                masks.push(image);
            } else if is_smaller_likeness(&base, &image) {
                overviews.push(image);
            }
        }
        files.push(sidecar);
    }
    overviews.sort_by_key(|image| std::cmp::Reverse(image.size()));
    overviews.dedup_by_key(|image| image.size());
    let mut levels: Vec<TiffLevel> = Vec::with_capacity(1 + overviews.len());
    for image in std::iter::once(base).chain(overviews) {
        let mask = masks
            .iter()
            .find(|mask| mask.size() == image.size())
            .cloned();
        // Such an overview shows what the map's mask hides: `gdaladdo -ro` writes none of a mask in the map's own file.
        if mask.is_none() && levels.first().is_some_and(|full| full.mask.is_some()) {
            continue;
        }
        check_complete(&image)?;
        if let Some(mask) = &mask {
            check_complete(mask)?;
        }
        levels.push(TiffLevel { image, mask });
    }
    let external_overviews = levels
        .iter()
        .filter(|level| level.image.path.as_path() != path)
        .count();
    Ok(TiffImages {
        levels,
        files,
        external_overviews,
    })
}

fn all_images(path: &Path) -> Result<Vec<TiffImage>, GeoError> {
    // Blocks are cached by us, as finished pixels.
    let options = OpenOptions {
        block_cache_bytes: 0,
        block_cache_slots: 0,
        decode_output_bytes: MAX_BLOCK_BYTES,
        ..OpenOptions::default()
    };
    let file = TiffFile::open_with_options(path, options).map_err(|e| tiff_error(path, e))?;
    let file = Arc::new(file);
    let shared_path = Arc::new(path.to_path_buf());
    let mut images = Vec::new();
    for ifd in file.ifds() {
        let mut push = |ifd: Ifd| {
            images.push(TiffImage {
                file: Arc::clone(&file),
                ifd: Arc::new(ifd),
                path: Arc::clone(&shared_path),
            });
        };
        push(ifd.clone());
        for offset in sub_ifd_offsets(&file, ifd).map_err(|e| tiff_error(path, e))? {
            push(
                file.read_ifd_at_offset(offset)
                    .map_err(|e| tiff_error(path, e))?,
            );
        }
    }
    Ok(images)
}

/// Where the sub-images of an image are.
fn sub_ifd_offsets(file: &TiffFile, ifd: &Ifd) -> Result<Vec<u64>, TiffError> {
    let Some(tag) = ifd.tag(TAG_SUB_IFDS) else {
        return Ok(Vec::new());
    };
    if tag.tag_type != TagType::Unknown(TYPE_IFD) {
        return Ok(ifd.sub_ifd_offsets().unwrap_or_default());
    }
    // The library does not know the type and takes it for bytes.
    let source = file.source();
    let number = |bytes: &[u8]| {
        let push = |n: u64, &byte: &u8| (n << 8) | u64::from(byte);
        match file.byte_order() {
            ByteOrder::LittleEndian => bytes.iter().rev().fold(0, push),
            ByteOrder::BigEndian => bytes.iter().fold(0, push),
        }
    };
    // Bytes of the number of entries, of an entry, and of the value at its end.
    let (count_len, entry_len, value_len) = if file.is_bigtiff() {
        (8, 20, 8)
    } else {
        (2, 12, 4)
    };
    let count = number(&source.read_exact_at(ifd.offset(), count_len)?) as usize;
    let entries = source.read_exact_at(ifd.offset() + count_len as u64, count * entry_len)?;
    let is_sub_ifds = |entry: &&[u8]| number(&entry[..2]) == u64::from(TAG_SUB_IFDS);
    let Some(entry) = entries.chunks_exact(entry_len).find(is_sub_ifds) else {
        return Ok(Vec::new());
    };
    let value = &entry[entry_len - value_len..];
    let len = usize::try_from(tag.count.saturating_mul(4)).unwrap_or(usize::MAX);
    let offsets = if len <= value_len {
        value[..len].to_vec()
    } else {
        source.read_exact_at(number(value), len)?
    };
    Ok(offsets.chunks_exact(4).map(number).collect())
}

fn sidecar(path: &Path, ending: &str) -> Option<PathBuf> {
    let mut name = path.as_os_str().to_os_string();
    name.push(".");
    name.push(ending);
    let path = PathBuf::from(name);
    path.is_file().then_some(path)
}

fn subfile_type(image: &TiffImage) -> u64 {
    if let Some(flags) = image
        .ifd
        .tag(TAG_NEW_SUBFILE_TYPE)
        .and_then(|t| t.value.as_u64())
    {
        return flags;
    }
    match image
        .ifd
        .tag(TAG_SUBFILE_TYPE)
        .and_then(|t| t.value.as_u16())
    {
        Some(2) => SUBFILE_REDUCED,
        _ => 0,
    }
}

fn is_reduced(image: &TiffImage) -> bool {
    subfile_type(image) & SUBFILE_REDUCED != 0
}

fn is_mask(image: &TiffImage) -> bool {
    subfile_type(image) & SUBFILE_MASK != 0
        || image.ifd.photometric_interpretation() == Some(PHOTOMETRIC_MASK)
}

fn is_overview(base: &TiffImage, image: &TiffImage) -> bool {
    !is_mask(image) && is_reduced(image) && is_smaller_likeness(base, image)
}

fn is_smaller_likeness(base: &TiffImage, image: &TiffImage) -> bool {
    let ((bw, bh), (w, h)) = (base.size(), image.size());
    if w == 0 || h == 0 || w >= bw || h > bh {
        return false;
    }
    let (fx, fy) = (bw as f64 / w as f64, bh as f64 / h as f64);
    // Sizes are rounded: a pixel of the smaller side is allowed.
    let rounding = 1.0 / (w.min(h)) as f64;
    (fx / fy - 1.0).abs() < MAX_ASPECT_CHANGE + rounding
        && image.ifd.samples_per_pixel() == base.ifd.samples_per_pixel()
        && image.ifd.bits_per_sample().ok() == base.ifd.bits_per_sample().ok()
}

/// Refuses a file that ends before its last block does.
fn check_complete(image: &TiffImage) -> Result<(), GeoError> {
    let ifd = &image.ifd;
    let (offsets, counts) = if ifd.is_tiled() {
        (ifd.tile_offsets(), ifd.tile_byte_counts())
    } else {
        (ifd.strip_offsets(), ifd.strip_byte_counts())
    };
    let (Some(offsets), Some(counts)) = (offsets, counts) else {
        return Err(GeoError::damaged(
            &image.path,
            "it does not say where its pixels are",
        ));
    };
    let last = offsets.len().saturating_sub(1);
    let last_bytes = last_strip_bytes(ifd);
    let needed = offsets
        .iter()
        .zip(&counts)
        .enumerate()
        .filter(|(_, (offset, count))| **offset != 0 && **count != 0)
        .map(|(i, (offset, &count))| {
            let stored = last_bytes.filter(|_| i == last).unwrap_or(count);
            offset.saturating_add(stored.min(count))
        })
        .max()
        .unwrap_or(0);
    let found = image.file.source().len();
    let last_starts = offsets.last().copied().unwrap_or(0);
    if needed > found || last_starts > found {
        return Err(GeoError::Truncated {
            path: image.path.to_path_buf(),
            needed_bytes: needed.max(last_starts),
            found_bytes: found,
        });
    }
    Ok(())
}

/// Bytes of the rows in the last strip of an uncompressed image: some writers declare a full strip where fewer rows are stored.
fn last_strip_bytes(ifd: &Ifd) -> Option<u64> {
    if ifd.compression() != 1 || ifd.is_tiled() {
        return None;
    }
    let layout = ifd.raster_layout().ok()?;
    let height = u64::from(ifd.height());
    let rows_per_strip = u64::from(ifd.rows_per_strip()).clamp(1, height);
    let rows = (height - 1) % rows_per_strip + 1;
    let samples = match layout.planar_configuration {
        1 => layout.samples_per_pixel as u64,
        _ => 1,
    };
    let row_bits = u64::from(ifd.width()) * samples * u64::from(layout.bits_per_sample);
    rows.checked_mul(row_bits.div_ceil(8))
}

pub(crate) fn tiff_error(path: &Path, error: TiffError) -> GeoError {
    let unsupported = |what: String| GeoError::Unsupported {
        path: path.to_path_buf(),
        what,
        advice: ADVICE_TILE_IT,
    };
    match error {
        TiffError::Io(source, _) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            GeoError::io(path, source)
        }
        // What it says of bytes that are there counts from that offset.
        TiffError::Truncated { offset, needed, .. } => GeoError::Truncated {
            path: path.to_path_buf(),
            needed_bytes: offset.saturating_add(needed),
            found_bytes: std::fs::metadata(path).map_or(0, |m| m.len()),
        },
        TiffError::OffsetOutOfBounds {
            offset,
            length,
            data_len,
        } => GeoError::Truncated {
            path: path.to_path_buf(),
            needed_bytes: offset.saturating_add(length),
            found_bytes: data_len,
        },
        TiffError::UnsupportedCompression(_)
        | TiffError::UnsupportedPredictor(_)
        | TiffError::UnsupportedPlanarConfiguration(_)
        | TiffError::InvalidImageLayout(_) => unsupported(error.to_string()),
        TiffError::UnsupportedBitsPerSample(_) | TiffError::UnsupportedSampleFormat(_) => {
            GeoError::Unsupported {
                path: path.to_path_buf(),
                what: error.to_string(),
                advice: ADVICE_SAMPLES,
            }
        }
        TiffError::DecodeOutputTooLarge { requested, .. } => {
            unsupported(format!("a strip or tile of {} MiB", requested >> 20))
        }
        other => GeoError::damaged(path, other),
    }
}
