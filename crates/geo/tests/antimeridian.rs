//! Maps of several files on both sides of the antimeridian.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use std::path::Path;

use grimnet_geo::{LonLat, MapOptions, MapPx, Raster, WindowPx, distance_m, open_map};
use support::{Tag, double, short, write_map};

/// Half the circumference of the sphere of EPSG:3857, metres.
const HALF_WORLD: f64 = std::f64::consts::PI * 6_378_137.0;

const EAST_OF_IT: [u8; 3] = [200, 10, 10];
const WEST_OF_IT: [u8; 3] = [10, 10, 200];

/// Tags of a map with this left edge, top and pixel size in a geographic (2) or projected (1) CRS.
fn placed(left: f64, top: f64, pixel: f64, model: u16, code: u16) -> Vec<Tag> {
    let key = if model == 2 { 2048 } else { 3072 };
    vec![
        double(33550, &[pixel, pixel, 0.0]),
        double(33922, &[0.0, 0.0, 0.0, left, top, 0.0]),
        short(
            34735,
            &[
                1, 1, 0, 3, 1024, 0, 1, model, 1025, 0, 1, 1, key, 0, 1, code,
            ],
        ),
    ]
}

/// A map of two equal halves, with the antimeridian between them.
fn assert_halves(path: &Path) -> Box<dyn Raster> {
    let map = open_map(path, &MapOptions::default()).unwrap();
    let (width, height) = map.size_px();
    let half = width / 2;
    let window = WindowPx::new(0.0, 0.0, width as f64, height as f64);
    let patch = map.read(window, width as u32, height as u32).unwrap();
    assert!(patch.valid.pixels().all(|v| v.0[0] == 255));
    for (x, colour) in [(0, WEST_OF_IT), (half - 1, WEST_OF_IT), (half, EAST_OF_IT)] {
        assert_eq!(patch.rgb.get_pixel(x as u32, 5).0, colour, "{x}");
    }
    let georeference = map.georeference();
    let [west, _, east, _] = georeference.bounds_deg().unwrap();
    assert!(
        west < 180.0 && 180.0 < east && east - west < 0.01,
        "{west} {east}"
    );
    let seam = MapPx::new(half as f64, 3.0);
    let place = georeference.lonlat_from_map_px(seam).unwrap();
    let expected = LonLat::new(-180.0, place.lat_deg);
    assert!(distance_m(place, expected) < 0.01, "{place:?}");
    for lon_deg in [179.9999, -179.9999] {
        let px = georeference
            .map_px_from_lonlat(LonLat::new(lon_deg, place.lat_deg))
            .unwrap();
        assert!((0.0..width as f64).contains(&px.x), "{px:?}");
        assert_eq!(px.x > seam.x, lon_deg < 0.0, "{px:?}");
    }
    map
}

#[test]
fn several_geotiffs() {
    for (pixel, half_world, top, model, code) in [
        (1e-5, 180.0, -17.0, 2, 4326),
        (0.5, HALF_WORLD, -1.9e6, 1, 3857),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let east = placed(-half_world, top, pixel, model, code);
        let west = placed(half_world - 96.0 * pixel, top, pixel, model, code);
        write_map(&dir.path().join("a.tif"), (96, 40), east, |_, _| EAST_OF_IT);
        write_map(&dir.path().join("b.tif"), (96, 40), west, |_, _| WEST_OF_IT);
        assert_eq!(assert_halves(dir.path()).size_px(), (192, 40));
    }
}

#[test]
fn tiles_and_their_overviews() {
    let dir = tempfile::tempdir().unwrap();
    for zoom in [17_u32, 16] {
        let last = (1 << zoom) - 1;
        for (column, colour) in [(0, EAST_OF_IT), (last, WEST_OF_IT)] {
            let folder = dir.path().join(format!("{zoom}/{column}"));
            std::fs::create_dir_all(&folder).unwrap();
            let row = 70_000 >> (17 - zoom);
            image::RgbImage::from_pixel(256, 256, image::Rgb(colour))
                .save(folder.join(format!("{row}.png")))
                .unwrap();
        }
    }
    let map = assert_halves(dir.path());
    assert_eq!(map.size_px(), (512, 256));
    assert!(map.describe().contains("1 overviews"), "{}", map.describe());
    // A quarter of the resolution, from the overview.
    let small = map
        .read(WindowPx::new(0.0, 0.0, 512.0, 256.0), 128, 64)
        .unwrap();
    assert_eq!(small.rgb.get_pixel(10, 10).0, WEST_OF_IT);
    assert_eq!(small.rgb.get_pixel(117, 10).0, EAST_OF_IT);
}

#[test]
fn a_table_of_pictures() {
    let dir = tempfile::tempdir().unwrap();
    for (name, colour) in [("a.png", EAST_OF_IT), ("b.png", WEST_OF_IT)] {
        image::RgbImage::from_pixel(96, 40, image::Rgb(colour))
            .save(dir.path().join(name))
            .unwrap();
    }
    let table = dir.path().join("map.csv");
    std::fs::write(
        &table,
        "filename,ul_lat,ul_lon,lr_lat,lr_lon\n\
         a.png,-17,-180,-17.0004,-179.99904\n\
         b.png,-17,179.99904,-17.0004,180\n",
    )
    .unwrap();
    assert_eq!(assert_halves(&table).size_px(), (192, 40));
}
