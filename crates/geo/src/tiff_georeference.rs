//! The georeference tags of a TIFF file.

use geotiff_core::crs::RasterType;
use geotiff_core::geokeys::{self, GeoKeyDirectory};
use geotiff_core::tags::{
    TAG_GEO_ASCII_PARAMS, TAG_GEO_DOUBLE_PARAMS, TAG_GEO_KEY_DIRECTORY, TAG_MODEL_PIXEL_SCALE,
    TAG_MODEL_TIEPOINT, TAG_MODEL_TRANSFORMATION,
};
use geotiff_core::transform::GeoTransform;
use tiff_reader::Ifd;

use crate::tiff_images::TiffImage;
use crate::{Affine, GeoError};

/// GDAL's tag for rational polynomial coefficients.
const TAG_RPC: u16 = 50844;

/// The georeference in a TIFF file. Each part may be absent.
#[derive(Default)]
pub(crate) struct TiffPlace {
    /// Transform from pixels, at pixel corners.
    pub affine: Option<Affine>,
    /// Keys that describe the CRS.
    pub geokeys: Option<GeoKeyDirectory>,
    /// Advice, if the file has a kind of georeference that is not supported.
    pub other: Option<&'static str>,
}

/// Reads the georeference tags of an image.
pub(crate) fn place_of(image: &TiffImage) -> Result<TiffPlace, GeoError> {
    let ifd = &image.ifd;
    let damaged = |reason: &str| GeoError::damaged(&image.path, reason);
    let geokeys = match ifd.tag(TAG_GEO_KEY_DIRECTORY) {
        None => None,
        Some(tag) => {
            let directory = tag
                .value
                .as_u16_slice()
                .ok_or_else(|| damaged("its GeoKeys have the wrong type"))?;
            let doubles = doubles(ifd, TAG_GEO_DOUBLE_PARAMS).unwrap_or_default();
            let ascii = ifd
                .tag(TAG_GEO_ASCII_PARAMS)
                .and_then(|t| t.value.as_str())
                .unwrap_or("");
            let parsed = GeoKeyDirectory::parse(directory, &doubles, ascii)
                .ok_or_else(|| damaged("its GeoKeys cannot be parsed"))?;
            Some(parsed)
        }
    };
    let raster_type = geokeys
        .as_ref()
        .and_then(|keys| keys.get_short(geokeys::GT_RASTER_TYPE))
        .map_or(RasterType::PixelIsArea, RasterType::from_code);
    let tiepoints = doubles(ifd, TAG_MODEL_TIEPOINT).unwrap_or_default();
    let matrix = doubles(ifd, TAG_MODEL_TRANSFORMATION);
    // Of a file with both, GDAL takes scale and tie point, and the matrix only where those give no place.
    let scale = doubles(ifd, TAG_MODEL_PIXEL_SCALE).filter(|scale| {
        let has_sides = matches!(scale[..], [x, y, ..] if x != 0.0 && y != 0.0);
        matrix.is_none() || has_sides && tiepoints.len() >= 6
    });
    let transform = if let Some(scale) = scale {
        match (&scale[..], tiepoints.first_chunk::<6>()) {
            (&[x, y, ..], Some(tiepoint)) => {
                Some(GeoTransform::from_tiepoint_and_scale_with_raster_type(
                    tiepoint,
                    &[x, y, 0.0],
                    raster_type,
                ))
            }
            _ => return Err(damaged("it has a pixel scale without a tie point")),
        }
    } else if let Some(matrix) = matrix {
        let matrix: [f64; 16] = matrix
            .try_into()
            .map_err(|_| damaged("its ModelTransformation does not have 16 numbers"))?;
        Some(GeoTransform::from_transformation_matrix_with_raster_type(
            &matrix,
            raster_type,
        ))
    } else {
        None
    };
    let other = if transform.is_some() {
        None
    } else if tiepoints.len() > 6 {
        Some("it has ground control points only: warp it first, gdalwarp -t_srs EPSG:4326 IN OUT")
    } else if ifd.tag(TAG_RPC).is_some() {
        Some("it has RPC coefficients only: orthorectify it first, gdalwarp -rpc IN OUT")
    } else {
        None
    };
    let affine = transform
        .map(|t| {
            Affine::from_gdal([
                t.origin_x,
                t.pixel_width,
                t.skew_x,
                t.origin_y,
                t.skew_y,
                t.pixel_height,
            ])
        })
        .transpose()?;
    Ok(TiffPlace {
        affine,
        geokeys,
        other,
    })
}

fn doubles(ifd: &Ifd, tag: u16) -> Option<Vec<f64>> {
    ifd.tag(tag).and_then(|t| t.value.as_f64_vec())
}
