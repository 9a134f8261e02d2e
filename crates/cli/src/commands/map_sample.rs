//! A part of a map as a map of its own.

use grimnet_geo::{Affine, GeoError, Georeference, Raster, RasterPatch, WindowPx};

/// A rectangle in the middle of a map.
pub struct MapSample<'a> {
    map: &'a dyn Raster,
    left: u64,
    top: u64,
    size_px: (u64, u64),
    georeference: Georeference,
    share: f64,
}

impl<'a> MapSample<'a> {
    /// A square of `side_m` metres, or less where the map is smaller; `None` if the map has no place on Earth.
    pub fn in_the_middle(map: &'a dyn Raster, side_m: f64) -> Option<Self> {
        let whole = map.georeference();
        let (x_m, y_m) = whole.ground_resolution_m(whole.centre_px()).ok()?;
        let (width, height) = map.size_px();
        let side = |metres: f64, most: u64| ((side_m / metres).ceil() as u64).clamp(1, most);
        let size_px = (side(x_m, width), side(y_m, height));
        let (left, top) = ((width - size_px.0) / 2, (height - size_px.1) / 2);
        let [x, x_column, x_row, y, y_column, y_row] = whole.affine().to_gdal();
        let affine = Affine::from_gdal([
            x + x_column * left as f64 + x_row * top as f64,
            x_column,
            x_row,
            y + y_column * left as f64 + y_row * top as f64,
            y_column,
            y_row,
        ])
        .ok()?;
        let share = size_px.0 as f64 * x_m * size_px.1 as f64 * y_m / (side_m * side_m);
        Some(Self {
            map,
            left,
            top,
            size_px,
            georeference: Georeference::new(affine, whole.crs().clone(), size_px),
            share: share.min(1.0),
        })
    }

    /// Area, of the square that was asked for, `0.0..=1.0`.
    pub fn share(&self) -> f64 {
        self.share
    }
}

impl Raster for MapSample<'_> {
    fn size_px(&self) -> (u64, u64) {
        self.size_px
    }

    fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    /// Of nothing: reading a large map for it would take longer than what is measured.
    fn content_hash(&self) -> Result<[u8; 32], GeoError> {
        Ok([0; 32])
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        let window = WindowPx::new(
            window.x + self.left as f64,
            window.y + self.top as f64,
            window.w,
            window.h,
        );
        self.map.read(window, out_w, out_h)
    }

    fn describe(&self) -> String {
        format!("middle of {}", self.map.describe())
    }
}
