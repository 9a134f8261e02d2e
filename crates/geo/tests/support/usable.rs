//! What holds of every map that opens, whatever its file contains. The targets of `fuzz/` check it too.

use grimnet_geo::{MapPx, Raster, WindowPx};

/// Longest side of the window that stands for the whole map, pixels.
const MAX_WHOLE_PX: u64 = 2000;

/// Asks a map for all that it can give: places are on Earth, and windows give pixels or an error.
pub fn assert_usable(map: &dyn Raster) {
    let (width, height) = map.size_px();
    assert!(width > 0 && height > 0);
    let centre = MapPx::new(width as f64 / 2.0, height as f64 / 2.0);
    for point in [MapPx::new(0.0, 0.0), centre] {
        if let Ok(place) = map.georeference().lonlat_from_map_px(point) {
            assert!(place.lat_deg.abs() <= 90.0 + 1e-9, "{place:?}");
            assert!(place.lon_deg.is_finite(), "{place:?}");
        }
        let _ = map.georeference().ground_resolution_m(point);
    }
    assert!(!map.describe().is_empty());
    let _ = map.caveats();
    let _ = map.content_hash();
    let _ = map.read(WindowPx::new(1.0, 1.0, 8.0, 8.0), 8, 8);
    let _ = map.read(WindowPx::new(centre.x, centre.y, 300.5, 290.0), 41, 41);
    let (width, height) = (width.min(MAX_WHOLE_PX), height.min(MAX_WHOLE_PX));
    let whole = WindowPx::new(0.0, 0.0, width as f64, height as f64);
    let _ = map.read(whole, 16, 16);
}
