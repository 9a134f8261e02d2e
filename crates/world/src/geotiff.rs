//! GeoTIFF writing (OGC 19-008r4), tiled, deflated.

use std::io::{BufWriter, Seek, Write};
use std::path::Path;

use grimnet_output::AtomicFile;
use image::RgbImage;
use rayon::prelude::*;
use tiff::TiffResult;
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind};
use tiff::tags::Tag;

use crate::error::WorldError;

const TILE_PX: u32 = 256;
const MODEL_PIXEL_SCALE: u16 = 33550;
const MODEL_TIEPOINT: u16 = 33922;
const GEO_KEY_DIRECTORY: u16 = 34735;
const GEO_ASCII_PARAMS: u16 = 34737;

/// Writes `image` as a GeoTIFF, north up.
///
/// `north_west_m` is the outer corner of the top-left pixel (easting, northing) in the projected
/// system `epsg` (metres); `gsd_m` the side of a pixel.
///
/// # Errors
/// [`WorldError::Output`] or [`WorldError::Encode`], naming the file.
pub fn write_geotiff(
    path: &Path,
    image: &RgbImage,
    gsd_m: f64,
    north_west_m: [f64; 2],
    epsg: u16,
) -> Result<(), WorldError> {
    let (width, height) = image.dimensions();
    let (columns, rows) = (width.div_ceil(TILE_PX), height.div_ceil(TILE_PX));
    let encode = |error: tiff::TiffError| WorldError::encode(path, error);
    let tiles: Vec<Vec<u8>> = (0..columns * rows)
        .into_par_iter()
        .map(|t| deflate(&tile(image, t % columns * TILE_PX, t / columns * TILE_PX)))
        .collect::<Result<_, _>>()
        .map_err(|error| WorldError::encode(path, error))?;

    let mut out = BufWriter::new(AtomicFile::create(path)?);
    let mut encoder = TiffEncoder::new(&mut out).map_err(encode)?;
    let mut directory = encoder.image_directory().map_err(encode)?;
    let mut offsets = Vec::with_capacity(tiles.len());
    let mut sizes = Vec::with_capacity(tiles.len());
    for bytes in &tiles {
        let at = directory.write_data(bytes.as_slice()).map_err(encode)?;
        offsets.push(u32::try_from(at).map_err(|_| WorldError::encode(path, "larger than 4 GiB"))?);
        sizes.push(bytes.len() as u32);
    }
    write_raster_tags(&mut directory, [width, height], &offsets, &sizes).map_err(encode)?;
    write_geo_tags(&mut directory, gsd_m, north_west_m, epsg).map_err(encode)?;
    directory.finish().map_err(encode)?;
    let file = out
        .into_inner()
        .map_err(|error| WorldError::encode(path, error.into_error()))?;
    Ok(file.commit()?)
}

fn write_raster_tags<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, W, K>,
    [width, height]: [u32; 2],
    offsets: &[u32],
    sizes: &[u32],
) -> TiffResult<()> {
    directory.write_tag(Tag::ImageWidth, width)?;
    directory.write_tag(Tag::ImageLength, height)?;
    directory.write_tag(Tag::BitsPerSample, [8_u16; 3].as_slice())?;
    directory.write_tag(Tag::Compression, 8_u16)?; // Adobe deflate
    directory.write_tag(Tag::PhotometricInterpretation, 2_u16)?; // RGB
    directory.write_tag(Tag::SamplesPerPixel, 3_u16)?;
    directory.write_tag(Tag::PlanarConfiguration, 1_u16)?;
    directory.write_tag(Tag::SampleFormat, [1_u16; 3].as_slice())?;
    directory.write_tag(Tag::TileWidth, TILE_PX)?;
    directory.write_tag(Tag::TileLength, TILE_PX)?;
    directory.write_tag(Tag::TileOffsets, offsets)?;
    directory.write_tag(Tag::TileByteCounts, sizes)?;
    Ok(())
}

/// The tags of OGC GeoTIFF 1.1: pixel size, position of the top-left corner, coordinate system.
fn write_geo_tags<W: Write + Seek, K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, W, K>,
    gsd_m: f64,
    north_west_m: [f64; 2],
    epsg: u16,
) -> TiffResult<()> {
    let citation = "grimnet procedural world|";
    // Version 1.1.0 and the number of keys; then key, location, count, value.
    #[rustfmt::skip]
    let keys: [u16; 20] = [
        1, 1, 0, 4,
        1024, 0, 1, 1, // GTModelType: projected
        1025, 0, 1, 1, // GTRasterType: pixel is area
        1026, GEO_ASCII_PARAMS, citation.len() as u16, 0, // GTCitation
        3072, 0, 1, epsg, // ProjectedCRS
    ];
    let scale = [gsd_m, gsd_m, 0.0];
    let tie = [0.0, 0.0, 0.0, north_west_m[0], north_west_m[1], 0.0];
    directory.write_tag(Tag::Unknown(MODEL_PIXEL_SCALE), scale.as_slice())?;
    directory.write_tag(Tag::Unknown(MODEL_TIEPOINT), tie.as_slice())?;
    directory.write_tag(Tag::Unknown(GEO_KEY_DIRECTORY), keys.as_slice())?;
    directory.write_tag(Tag::Unknown(GEO_ASCII_PARAMS), citation)?;
    Ok(())
}

/// The bytes of a tile; pixels beyond the picture repeat its border.
fn tile(image: &RgbImage, x0: u32, y0: u32) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let mut bytes = Vec::with_capacity((TILE_PX * TILE_PX * 3) as usize);
    for y in 0..TILE_PX {
        for x in 0..TILE_PX {
            bytes.extend(
                image
                    .get_pixel((x0 + x).min(width - 1), (y0 + y).min(height - 1))
                    .0,
            );
        }
    }
    bytes
}

fn deflate(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes)?;
    encoder.finish()
}
