//! The affine transform from map pixels to coordinates.

use serde::{Deserialize, Serialize};

use crate::{GeoError, MapPx};

/// Smallest area of a pixel, as a share of the product of its sides: below it the pixel is a line and the inverse
/// transform is dominated by rounding errors.
const MIN_RELATIVE_PIXEL_AREA: f64 = 1e-9;

/// The transform from map pixels to the coordinates of a CRS, with the six coefficients of GDAL's
/// geotransform; maps may be rotated and sheared:
///
/// ```text
/// x = origin_x + x_from_col * col + x_from_row * row
/// y = origin_y + y_from_col * col + y_from_row * row
/// ```
///
/// Every value of this type is finite and has an inverse: the constructors and deserialisation refuse anything else.
///
/// ```
/// use grimnet_geo::{Affine, MapPx};
/// # fn main() -> Result<(), grimnet_geo::GeoError> {
/// let affine = Affine::from_gdal([500_000.0, 0.5, 0.0, 4_000_000.0, 0.0, -0.5])?;
/// assert_eq!(affine.xy_from_map_px(MapPx::new(10.0, 20.0)), (500_005.0, 3_999_990.0));
/// assert_eq!(affine.map_px_from_xy(500_005.0, 3_999_990.0), MapPx::new(10.0, 20.0));
/// // Both axes along the same line: no inverse.
/// assert!(Affine::from_gdal([0.0, 1.0, 2.0, 0.0, 1.0, 2.0]).is_err());
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Coefficients", into = "Coefficients")]
pub struct Affine {
    coefficients: Coefficients,
}

/// The coefficients as they are written in packs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Coefficients {
    origin_x: f64,
    x_from_col: f64,
    x_from_row: f64,
    origin_y: f64,
    y_from_col: f64,
    y_from_row: f64,
}

impl TryFrom<Coefficients> for Affine {
    type Error = GeoError;

    fn try_from(c: Coefficients) -> Result<Self, GeoError> {
        let affine = Self { coefficients: c };
        if affine.is_invertible() {
            Ok(affine)
        } else {
            Err(GeoError::SingularTransform {
                location: "geotransform".to_string(),
                coefficients: affine.to_gdal(),
            })
        }
    }
}

impl From<Affine> for Coefficients {
    fn from(affine: Affine) -> Self {
        affine.coefficients
    }
}

impl Affine {
    /// From GDAL's geotransform `[origin_x, x_from_col, x_from_row, origin_y, y_from_col, y_from_row]`: the
    /// coordinates of the outer corner of the top-left pixel, and their change by one pixel to the right (`col`) and
    /// down (`row`).
    ///
    /// # Errors
    /// Returns [`GeoError::SingularTransform`] if a coefficient is not finite or the transform has no inverse.
    pub fn from_gdal(t: [f64; 6]) -> Result<Self, GeoError> {
        Self::try_from(Coefficients {
            origin_x: t[0],
            x_from_col: t[1],
            x_from_row: t[2],
            origin_y: t[3],
            y_from_col: t[4],
            y_from_row: t[5],
        })
    }

    /// The same transform with coordinates in another unit: all multiplied by `factor`.
    ///
    /// # Errors
    /// Returns [`GeoError::SingularTransform`] if the result has no inverse.
    pub(crate) fn scaled(self, factor: f64) -> Result<Self, GeoError> {
        if factor == 1.0 {
            return Ok(self);
        }
        Self::from_gdal(self.to_gdal().map(|v| v * factor))
    }

    /// As GDAL's geotransform.
    pub const fn to_gdal(self) -> [f64; 6] {
        let c = self.coefficients;
        [
            c.origin_x,
            c.x_from_col,
            c.x_from_row,
            c.origin_y,
            c.y_from_col,
            c.y_from_row,
        ]
    }

    /// Coordinates of a map pixel.
    pub fn xy_from_map_px(&self, point: MapPx) -> (f64, f64) {
        let c = &self.coefficients;
        (
            c.origin_x + c.x_from_col * point.x + c.x_from_row * point.y,
            c.origin_y + c.y_from_col * point.x + c.y_from_row * point.y,
        )
    }

    /// Map pixel of coordinates.
    pub fn map_px_from_xy(&self, x: f64, y: f64) -> MapPx {
        let c = &self.coefficients;
        let (dx, dy) = (x - c.origin_x, y - c.origin_y);
        let det = self.determinant();
        MapPx::new(
            (c.y_from_row * dx - c.x_from_row * dy) / det,
            (c.x_from_col * dy - c.y_from_col * dx) / det,
        )
    }

    /// Signed area of a pixel in units of the CRS squared, never zero; negative for a map that is not mirrored (rows
    /// run downwards).
    pub fn determinant(&self) -> f64 {
        let c = &self.coefficients;
        c.x_from_col * c.y_from_row - c.x_from_row * c.y_from_col
    }

    fn is_invertible(&self) -> bool {
        let c = &self.coefficients;
        let finite = self.to_gdal().iter().all(|v| v.is_finite());
        let area = self.determinant().abs();
        let sides = c.x_from_col.hypot(c.y_from_col) * c.x_from_row.hypot(c.y_from_row);
        finite && area > MIN_RELATIVE_PIXEL_AREA * sides && area.is_normal()
    }
}
