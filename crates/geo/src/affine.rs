//! The affine transform from map pixels to coordinates.

use serde::{Deserialize, Serialize};

use crate::MapPx;

/// The transform from map pixels to the coordinates of a CRS, with the six coefficients of GDAL's
/// geotransform, so that rotated and sheared maps are at home:
///
/// ```text
/// x = origin_x + x_from_col * col + x_from_row * row
/// y = origin_y + y_from_col * col + y_from_row * row
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// x of the outer corner of the top-left pixel.
    pub origin_x: f64,
    /// Change of x by one pixel to the right.
    pub x_from_col: f64,
    /// Change of x by one pixel down.
    pub x_from_row: f64,
    /// y of the outer corner of the top-left pixel.
    pub origin_y: f64,
    /// Change of y by one pixel to the right.
    pub y_from_col: f64,
    /// Change of y by one pixel down.
    pub y_from_row: f64,
}

impl Affine {
    /// From GDAL's geotransform `[origin_x, x_from_col, x_from_row, origin_y, y_from_col, y_from_row]`.
    pub const fn from_gdal(t: [f64; 6]) -> Self {
        Self {
            origin_x: t[0],
            x_from_col: t[1],
            x_from_row: t[2],
            origin_y: t[3],
            y_from_col: t[4],
            y_from_row: t[5],
        }
    }

    /// As GDAL's geotransform.
    pub const fn to_gdal(self) -> [f64; 6] {
        [
            self.origin_x,
            self.x_from_col,
            self.x_from_row,
            self.origin_y,
            self.y_from_col,
            self.y_from_row,
        ]
    }

    /// Coordinates of a map pixel.
    pub fn xy_from_map_px(&self, place: MapPx) -> (f64, f64) {
        (
            self.origin_x + self.x_from_col * place.x + self.x_from_row * place.y,
            self.origin_y + self.y_from_col * place.x + self.y_from_row * place.y,
        )
    }

    /// Map pixel of coordinates. Not finite if the transform has no inverse: see
    /// [`Affine::is_invertible`].
    pub fn map_px_from_xy(&self, x: f64, y: f64) -> MapPx {
        let (dx, dy) = (x - self.origin_x, y - self.origin_y);
        let det = self.determinant();
        MapPx::new(
            (self.y_from_row * dx - self.x_from_row * dy) / det,
            (self.x_from_col * dy - self.y_from_col * dx) / det,
        )
    }

    /// Signed area of a pixel in units of the CRS squared; negative for a map that is not mirrored
    /// (rows run downwards).
    pub fn determinant(&self) -> f64 {
        self.x_from_col * self.y_from_row - self.x_from_row * self.y_from_col
    }

    /// Whether all coefficients are finite and a pixel has an area.
    pub fn is_invertible(&self) -> bool {
        let finite = self.to_gdal().iter().all(|v| v.is_finite());
        let area = self.determinant().abs();
        let sides = self.x_from_col.hypot(self.y_from_col) * self.x_from_row.hypot(self.y_from_row);
        // A pixel squashed to less than a billionth of its sides' product is a line.
        finite && area > 1e-9 * sides && area.is_normal()
    }
}
