//! GeoTIFF maps: opened, placed, and read in a corner and as a whole.
#![no_main]

use grimnet_fuzz_targets::{assert_named, file_of};
use grimnet_geo::{MapOptions, MapPx, WindowPx, open_map};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(bytes, "map.tif");
    let map = match open_map(&path, &MapOptions::default()) {
        Ok(map) => map,
        Err(error) => return assert_named(&error, "map."),
    };
    let (width, height) = map.size_px();
    assert!(width > 0 && height > 0);
    for (x, y) in [(0.0, 0.0), (width as f64 / 2.0, height as f64 / 2.0)] {
        if let Ok(place) = map.georeference().lonlat_from_map_px(MapPx::new(x, y)) {
            assert!(place.lat_deg.abs() <= 90.0 + 1e-9, "{place:?}");
            assert!(place.lon_deg.is_finite(), "{place:?}");
        }
        let _ = map.georeference().ground_resolution_m(MapPx::new(x, y));
    }
    let _ = map.read(WindowPx::new(1.0, 1.0, 8.0, 8.0), 8, 8);
    let whole = WindowPx::new(0.0, 0.0, width.min(2000) as f64, height.min(2000) as f64);
    let _ = map.read(whole, 16, 16);
});
