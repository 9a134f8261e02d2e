//! The grid of pixels of several pictures as one map.

use std::path::{Path, PathBuf};

use crate::antimeridian::AroundTheWorld;
use crate::{Affine, GeoError, Georeference, WindowPx};

/// Edges within this distance of whole pixels lie on them, pixels.
const WHOLE_PIXEL_TOLERANCE: f64 = 1e-3;
/// Ratio of sides above which pixels have other sizes.
const SIZE_TOLERANCE: f64 = 1e-9;

/// The grid of pixels that pictures are put on.
pub(crate) struct MosaicGrid {
    left: f64,
    top: f64,
    /// Width and height of a pixel, units of the CRS.
    pixel: (f64, f64),
    /// Width and height, pixels.
    pub size_px: (u64, u64),
    /// Where x is taken, if it repeats around the world.
    around: Option<AroundTheWorld>,
}

impl MosaicGrid {
    /// The grid of `pictures` with their sizes in pixels: of the finest of their resolutions, and as large as needed. `path` is the
    /// list of `files`.
    pub fn of(
        path: &Path,
        files: &[PathBuf],
        pictures: &[(Georeference, (u64, u64))],
    ) -> Result<Self, GeoError> {
        let unsupported = |file: &Path, what: String| GeoError::Unsupported {
            path: file.to_path_buf(),
            what,
            advice: "bring all of them into one coordinate system, north up: gdalwarp -t_srs EPSG:CODE IN OUT.tif",
        };
        let Some((first, _)) = pictures.first() else {
            return Err(GeoError::NotAMap {
                path: path.to_path_buf(),
                reason: "it lists no GeoTIFFs".to_string(),
            });
        };
        let mut grid = Self {
            left: f64::INFINITY,
            top: f64::NEG_INFINITY,
            pixel: (f64::INFINITY, f64::INFINITY),
            size_px: (0, 0),
            around: None,
        };
        let mut bottom = f64::INFINITY;
        let mut edges = Vec::with_capacity(pictures.len());
        for (file, (place, size_px)) in files.iter().zip(pictures) {
            if place.crs() != first.crs() {
                return Err(unsupported(
                    file,
                    format!(
                        "coordinate system {} beside {} of {}",
                        place.crs(),
                        first.crs(),
                        files[0].display()
                    ),
                ));
            }
            let [x, width, skew_x, y, skew_y, height] = place.affine().to_gdal();
            if skew_x != 0.0 || skew_y != 0.0 || width <= 0.0 || height >= 0.0 {
                return Err(unsupported(
                    file,
                    "a picture that is not north up".to_string(),
                ));
            }
            edges.push((x, x + width * size_px.0 as f64));
            grid.top = grid.top.max(y);
            bottom = bottom.min(y + height * size_px.1 as f64);
            grid.pixel = (grid.pixel.0.min(width), grid.pixel.1.min(-height));
        }
        let period = first.crs().period_x();
        grid.around =
            period.map(|period| AroundTheWorld::from_edges(edges.iter().copied(), period));
        let mut right = f64::NEG_INFINITY;
        for (from, to) in edges {
            let shift = grid.shift(from);
            grid.left = grid.left.min(from + shift);
            right = right.max(to + shift);
        }
        let count = |length: f64, pixel: f64| {
            ((length / pixel - WHOLE_PIXEL_TOLERANCE).ceil() as u64).max(1)
        };
        grid.size_px = (
            count(right - grid.left, grid.pixel.0),
            count(grid.top - bottom, grid.pixel.1),
        );
        Ok(grid)
    }

    /// What a picture with this left edge is moved by, to lie on the same side of the antimeridian as the others.
    fn shift(&self, left: f64) -> f64 {
        self.around.map_or(0.0, |around| around.shift(left))
    }

    /// From pixels of the grid to coordinates.
    pub fn affine(&self, path: &Path) -> Result<Affine, GeoError> {
        Affine::from_gdal([self.left, self.pixel.0, 0.0, self.top, 0.0, -self.pixel.1])
            .map_err(|e| e.in_file(path))
    }

    /// Where a picture lies, pixels of the grid.
    pub fn place(&self, place: &Georeference, size_px: (u64, u64)) -> WindowPx {
        let [x, width, _, y, _, height] = place.affine().to_gdal();
        let side = |count: u64, pixel: f64, grid: f64| {
            let scale = pixel / grid;
            if (scale - 1.0).abs() < SIZE_TOLERANCE {
                count as f64
            } else {
                count as f64 * scale
            }
        };
        WindowPx::new(
            snapped((x + self.shift(x) - self.left) / self.pixel.0),
            snapped((self.top - y) / self.pixel.1),
            side(size_px.0, width, self.pixel.0),
            side(size_px.1, -height, self.pixel.1),
        )
    }
}

fn snapped(px: f64) -> f64 {
    if (px - px.round()).abs() < WHOLE_PIXEL_TOLERANCE {
        px.round()
    } else {
        px
    }
}
