//! Tiles as they are sent: rendered and encoded.

use std::io::Cursor;

use axum::body::Bytes;
use axum::http::HeaderValue;
use grimnet_geo::GeoError;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageError, ImageFormat, RgbaImage};

use crate::error::ServeError;
use crate::maps::ServedMap;
use crate::tile_address::TileAddress;
use crate::tile_cache::{Layer, Tile};
use crate::tile_picture::{map_picture, outline_picture};

/// Quality of JPEG tiles.
const JPEG_QUALITY: u8 = 88;

/// A tile of a map: the map itself, or the outlines of its pack.
///
/// # Errors
/// Returns an error if the map cannot be read.
pub(crate) fn rendered_tile(
    map: &ServedMap,
    layer: Layer,
    address: TileAddress,
) -> Result<Tile, ServeError> {
    let picture = match (layer, &map.raster) {
        (Layer::Map, Some(raster)) => map_picture(address, raster.as_ref()),
        _ => outline_picture(address, map.localizer.pack()),
    };
    let picture = match picture {
        // The projection does not reach there: nothing of the map is there.
        Err(GeoError::OutsideDomain { .. }) => RgbaImage::new(1, 1),
        picture => picture?,
    };
    Ok(encoded(picture)?)
}

/// JPEG, which has no transparency, or PNG.
fn encoded(picture: RgbaImage) -> Result<Tile, ImageError> {
    let is_opaque = picture.pixels().all(|pixel| pixel.0[3] == 255);
    let mut bytes = Cursor::new(Vec::new());
    let media_type = if is_opaque {
        let rgb = DynamicImage::ImageRgba8(picture).into_rgb8();
        rgb.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY))?;
        "image/jpeg"
    } else {
        picture.write_to(&mut bytes, ImageFormat::Png)?;
        "image/png"
    };
    let bytes = Bytes::from(bytes.into_inner());
    let tag = format!("\"{}\"", &blake3::hash(&bytes).to_hex()[..32]);
    Ok(Tile {
        bytes,
        media_type,
        tag: HeaderValue::from_str(&tag).unwrap_or(HeaderValue::from_static("\"\"")),
    })
}
