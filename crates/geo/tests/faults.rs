//! Faults of maps, and what is said about them.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod support;

use std::path::{Path, PathBuf};

use grimnet_geo::{GeoError, LonLat, MapOptions, MapPx, Raster, WindowPx, distance_m, open_map};
use image::{GrayImage, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use support::{double, geo_tags, long, long8, rgb_tags, short, write_bigtiff, write_map};
use tempfile::TempDir;

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

fn open(path: &Path) -> Result<Box<dyn Raster>, GeoError> {
    open_map(path, &MapOptions::default())
}

/// The error, which must name the file and hold a word of advice.
#[track_caller]
fn refused(result: Result<Box<dyn Raster>, GeoError>, file: &Path, words: &[&str]) -> GeoError {
    let error = match result {
        Ok(map) => panic!("it was opened: {}", map.describe()),
        Err(error) => error,
    };
    let text = error.to_string();
    let name = file.file_name().unwrap().to_string_lossy();
    assert!(text.contains(name.as_ref()), "does not name {name}: {text}");
    for word in words {
        assert!(text.contains(word), "does not say '{word}': {text}");
    }
    error
}

fn with_corners(path: &Path, corners: [f64; 4]) -> Result<Box<dyn Raster>, GeoError> {
    open_map(
        path,
        &MapOptions {
            corners: Some(corners),
            ..MapOptions::default()
        },
    )
}

fn with_crs(path: &Path, crs: &str) -> Result<Box<dyn Raster>, GeoError> {
    open_map(
        path,
        &MapOptions {
            crs: Some(crs.to_string()),
            ..MapOptions::default()
        },
    )
}

fn colours(x: u32, y: u32) -> [u8; 3] {
    [(x * 5) as u8, (y * 7) as u8, (x + y) as u8]
}

fn picture(path: &Path, width: u32, height: u32) {
    RgbImage::from_fn(width, height, |x, y| Rgb(colours(x, y)))
        .save(path)
        .unwrap();
}

fn golden_map(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden/maps")
        .join(name)
}

#[test]
fn a_picture_without_georeference_is_refused() {
    let dir = folder();
    for name in ["map.png", "map.jpg"] {
        let path = dir.path().join(name);
        picture(&path, 20, 10);
        let error = refused(open(&path), &path, &["corners", "coordinate system"]);
        assert!(matches!(error, GeoError::NoGeoreference { .. }));
    }
    // A CRS alone is not a place.
    let path = dir.path().join("map.png");
    let error = refused(with_crs(&path, "EPSG:32651"), &path, &["corners"]);
    assert!(matches!(error, GeoError::NoGeoreference { .. }));
}

#[test]
fn a_tiff_without_georeference_is_refused() {
    let dir = folder();
    let path = dir.path().join("plain.tif");
    write_map(&path, (20, 10), vec![], colours);
    let error = refused(open(&path), &path, &["corners"]);
    assert!(matches!(error, GeoError::NoGeoreference { .. }));
    let map = with_corners(&path, [120.0, 24.0, 120.002, 24.001]).unwrap();
    let centre = map
        .georeference()
        .lonlat_from_map_px(MapPx::new(10.0, 5.0))
        .unwrap();
    assert!(distance_m(centre, LonLat::new(120.001, 24.0005)) < 1e-6);
}

#[test]
fn ground_control_points_alone_are_refused_with_advice() {
    let dir = folder();
    let path = dir.path().join("gcp.tif");
    let points: Vec<f64> = (0..4)
        .flat_map(|i| [f64::from(i), 0.0, 0.0, 1.0, 2.0, 0.0])
        .collect();
    write_map(&path, (20, 10), vec![double(33922, &points)], colours);
    let error = refused(open(&path), &path, &["gdalwarp"]);
    assert!(matches!(error, GeoError::NoGeoreference { .. }));
}

#[test]
fn a_transform_without_crs_is_refused_until_it_is_given() {
    let dir = folder();
    let path = dir.path().join("nocrs.tif");
    let mut tags = geo_tags(32651);
    tags.pop();
    write_map(&path, (20, 10), tags, colours);
    let error = refused(open(&path), &path, &["coordinate system"]);
    assert!(matches!(error, GeoError::MissingCrs { .. }));
    let map = with_crs(&path, "EPSG:32651").unwrap();
    assert_eq!(map.georeference().crs().definition(), "EPSG:32651");

    let png = dir.path().join("world.png");
    picture(&png, 20, 10);
    std::fs::write(
        dir.path().join("world.pgw"),
        "0.5\n0\n0\n-0.5\n300000.25\n2699999.75\n",
    )
    .unwrap();
    let error = refused(open(&png), &png, &["coordinate system"]);
    assert!(matches!(error, GeoError::MissingCrs { .. }));
    let map = with_crs(&png, "32651").unwrap();
    assert_eq!(
        map.georeference().affine().to_gdal(),
        [300000.0, 0.5, 0.0, 2700000.0, 0.0, -0.5]
    );
}

#[test]
fn an_unknown_crs_is_refused() {
    let dir = folder();
    let path = dir.path().join("unknown.tif");
    write_map(&path, (20, 10), geo_tags(9999), colours);
    let error = refused(open(&path), &path, &["EPSG:9999", "EPSG:CODE", "gdalwarp"]);
    assert!(matches!(error, GeoError::UnsupportedCrs { .. }));
    for crs in [
        "EPSG:9999",
        "EPSG:999999",
        "mars",
        "",
        "+proj=nosuch",
        "ESRI:4326",
    ] {
        let error = match with_crs(&path, crs) {
            Err(error) => error,
            Ok(map) => panic!("{crs}: {}", map.describe()),
        };
        assert!(
            matches!(error, GeoError::UnknownCrs { .. }),
            "{crs}: {error}"
        );
        assert!(error.to_string().contains("EPSG:32651"), "{error}");
    }
}

#[test]
fn a_crs_that_does_not_fit_is_refused() {
    let dir = folder();
    let path = dir.path().join("utm.tif");
    write_map(&path, (20, 10), geo_tags(32651), colours);
    // Metres taken for degrees.
    let error = refused(
        with_crs(&path, "EPSG:4326"),
        &path,
        &["EPSG:4326", "EPSG:CODE"],
    );
    assert!(matches!(error, GeoError::UnsupportedCrs { .. }));
}

#[test]
fn a_singular_transform_is_refused() {
    let dir = folder();
    let path = dir.path().join("flat.tif");
    let mut tags = geo_tags(32651);
    tags[0] = double(33550, &[0.0, 0.5, 0.0]);
    write_map(&path, (20, 10), tags, colours);
    let error = refused(open(&path), &path, &["no inverse"]);
    assert!(matches!(error, GeoError::SingularTransform { .. }));

    let png = dir.path().join("bad.png");
    picture(&png, 20, 10);
    for text in ["1 2 3", "0 0 0 0 0 0", "a b c d e f", "1 0 0 -1 nan 5"] {
        std::fs::write(dir.path().join("bad.pgw"), text).unwrap();
        let error = match with_crs(&png, "EPSG:32651") {
            Err(error) => error,
            Ok(map) => panic!("{text}: {}", map.describe()),
        };
        assert!(matches!(error, GeoError::BadWorldFile { .. }), "{error}");
        assert!(error.to_string().contains("bad.pgw"), "{error}");
    }
}

#[test]
fn swapped_corners_are_told() {
    let dir = folder();
    let path = dir.path().join("map.png");
    picture(&path, 200, 100);
    // A latitude of 120 degrees.
    let error = with_corners(&path, [24.0, 120.0, 24.001, 120.002])
        .err()
        .unwrap();
    assert!(matches!(error, GeoError::SwappedLonLat { .. }), "{error}");
    assert!(
        error.to_string().contains("LL_LON,LL_LAT,UR_LON,UR_LAT"),
        "{error}"
    );
    // Both could be latitudes: the shape of the pixels tells. 60.4 N 22.4 E, 0.135 m pixels.
    let size = (147, 127);
    let path = dir.path().join("finland.png");
    picture(&path, size.0, size.1);
    let (w, e, s, n) = (22.460441, 22.464059, 60.402409, 60.403962);
    assert!(with_corners(&path, [w, s, e, n]).is_ok());
    let error = with_corners(&path, [s, w, n, e]).err().unwrap();
    assert!(matches!(error, GeoError::SwappedLonLat { .. }), "{error}");
}

#[test]
fn corners_that_span_nothing_are_refused() {
    let dir = folder();
    let path = dir.path().join("map.png");
    picture(&path, 20, 10);
    for corners in [
        [120.0, 24.0, 119.9, 24.1],
        [120.0, 24.0, 120.1, 23.9],
        [120.0, 24.0, 120.0, 24.0],
        [f64::NAN, 24.0, 120.1, 24.1],
        [120.0, 24.0, f64::INFINITY, 24.1],
        [120.0, -200.0, 120.1, 24.1],
        [1e9, 24.0, 2e9, 24.1],
    ] {
        let error = with_corners(&path, corners).err().unwrap();
        assert!(
            matches!(error, GeoError::BadCorners { .. }),
            "{corners:?}: {error}"
        );
    }
}

fn table(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("map.csv");
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn tables_are_checked_line_by_line() {
    let dir = folder();
    picture(&dir.path().join("a.png"), 147, 127);
    let head = "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n";
    let right = "a.png,60.403962,22.460441,60.402409,22.464059\n";
    assert!(open(&table(dir.path(), &format!("{head}{right}"))).is_ok());

    let swapped = "a.png,22.464059,60.402409,22.460441,60.403962\n";
    let path = table(dir.path(), &format!("{head}{right}{swapped}"));
    let error = refused(open(&path), &path, &["line 3"]);
    assert!(matches!(error, GeoError::SwappedLonLat { .. }));

    for (rows, word) in [
        ("", "no pictures"),
        ("a.png,60.4,22.4,sixty,22.5\n", "'sixty'"),
        ("a.png,60.4,22.4\n", "3 values"),
        (",60.4,22.4,60.3,22.5\n", "file name"),
    ] {
        let path = table(dir.path(), &format!("{head}{rows}"));
        let error = refused(open(&path), &path, &[word]);
        assert!(matches!(error, GeoError::BadTable { .. }), "{error}");
    }
    let path = table(dir.path(), "filename,top_left_lat\na.png,60.4\n");
    assert!(matches!(
        refused(open(&path), &path, &["corner"]),
        GeoError::BadTable { .. }
    ));
    let path = table(dir.path(), "x,y\n1,2\n");
    assert!(matches!(
        refused(open(&path), &path, &["filename"]),
        GeoError::BadTable { .. }
    ));
    // The picture that is missing is named, not the table.
    let path = table(
        dir.path(),
        &format!("{head}b.png,60.403962,22.460441,60.402409,22.464059\n"),
    );
    let error = refused(open(&path), &dir.path().join("b.png"), &[]);
    assert!(matches!(error, GeoError::Io { .. }));
}

#[test]
fn tables_in_the_papers_words_are_read_too() {
    let dir = folder();
    picture(&dir.path().join("a.png"), 147, 127);
    let path = table(
        dir.path(),
        "Filename, LL_lon, LL_lat, UR_lon, UR_lat\na.png, 22.460441, 60.402409, 22.464059, 60.403962\n",
    );
    let map = open(&path).unwrap();
    assert_eq!(map.size_px(), (147, 127));
    let corner = map
        .georeference()
        .lonlat_from_map_px(MapPx::new(0.0, 0.0))
        .unwrap();
    assert!(distance_m(corner, LonLat::new(22.460441, 60.403962)) < 1e-6);
    let patch = map
        .read(WindowPx::new(10.0, 20.0, 30.0, 30.0), 30, 30)
        .unwrap();
    assert!(patch.valid.iter().all(|&v| v == 255));
    assert_eq!(patch.rgb.get_pixel(3, 4).0, colours(13, 24));
}

#[test]
fn a_mosaic_joins_its_pictures_and_leaves_holes_without_data() {
    let dir = folder();
    for (name, shade) in [("a.png", 50), ("b.png", 200)] {
        RgbImage::from_pixel(100, 100, Rgb([shade; 3]))
            .save(dir.path().join(name))
            .unwrap();
    }
    // b lies to the right of a, half as far up, and overlaps it by ten pixels.
    let path = table(
        dir.path(),
        "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n\
         a.png,0.0100,10.0000,0.0000,10.0100\n\
         b.png,0.0050,10.0090,-0.0050,10.0190\n",
    );
    let map = open(&path).unwrap();
    let (w, h) = map.size_px();
    assert!(
        (190..=191).contains(&w) && (150..=151).contains(&h),
        "{w} x {h}"
    );
    let patch = map
        .read(WindowPx::new(0.0, 0.0, 190.0, 150.0), 190, 150)
        .unwrap();
    let at = |x, y| {
        (
            patch.rgb.get_pixel(x, y).0[0],
            patch.valid.get_pixel(x, y).0[0],
        )
    };
    assert_eq!(at(50, 50), (50, 255));
    assert_eq!(
        at(95, 75),
        (50, 255),
        "the first picture shows where both are"
    );
    assert_eq!(at(150, 100), (200, 255));
    assert_eq!(at(95, 120), (200, 255));
    assert_eq!(at(150, 20), (0, 0));
    assert_eq!(at(20, 130), (0, 0));
}

#[test]
fn the_antimeridian_is_crossed_the_short_way() {
    let dir = folder();
    let path = dir.path().join("fiji.png");
    picture(&path, 200, 200);
    let map = with_corners(&path, [179.999, -17.001, -179.999, -16.999]).unwrap();
    let check = |map: &dyn Raster, side: f64| {
        let g = map.georeference();
        let (x_m, _) = g.ground_resolution_m(MapPx::new(side / 2.0, 10.0)).unwrap();
        assert!(x_m < 6.0, "{x_m}");
        for x in [0.1, side / 2.0 - 0.1, side / 2.0 + 0.1, side - 0.1] {
            let place = g.lonlat_from_map_px(MapPx::new(x, 10.0)).unwrap();
            assert!((-180.0..180.0).contains(&place.lon_deg));
            let back = g.map_px_from_lonlat(place).unwrap();
            assert!(
                (back.x - x).abs() < 1e-4 && (back.y - 10.0).abs() < 1e-4,
                "{x}: {back:?}"
            );
        }
        let left = g.lonlat_from_map_px(MapPx::new(0.0, 0.0)).unwrap();
        let right = g.lonlat_from_map_px(MapPx::new(side, 0.0)).unwrap();
        assert!(left.lon_deg > 179.9 && right.lon_deg < -179.9);
        assert!(distance_m(left, right) < 600.0);
    };
    check(map.as_ref(), 200.0);
    check(
        open(&golden_map("antimeridian.tif")).unwrap().as_ref(),
        96.0,
    );
    check(
        open(&golden_map("antimeridian_degrees.tif"))
            .unwrap()
            .as_ref(),
        96.0,
    );
    // Web Mercator beyond its edge.
    let path = dir.path().join("mercator.tif");
    let mut tags = geo_tags(3857);
    tags[1] = double(33922, &[0.0, 0.0, 0.0, 20_037_458.0, -1_900_000.0, 0.0]);
    write_map(&path, (200, 20), tags, colours);
    check(open(&path).unwrap().as_ref(), 200.0);
    // A mosaic with a picture on either side.
    for name in ["a.png", "b.png"] {
        picture(&dir.path().join(name), 100, 100);
    }
    let table = table(
        dir.path(),
        "filename,top_left_lat,top_left_lon,bottom_right_lat,bottom_right_lon\n\
         a.png,-16.999,179.999,-17.000,180.000\n\
         b.png,-16.999,-180.000,-17.000,-179.999\n",
    );
    let map = open(&table).unwrap();
    assert!(
        (200..=201).contains(&map.size_px().0),
        "{:?}",
        map.size_px()
    );
    check(map.as_ref(), 200.0);
}

#[test]
fn a_map_smaller_than_a_tile_is_read_and_padded() {
    let dir = folder();
    let path = dir.path().join("small.tif");
    write_map(&path, (20, 10), geo_tags(32651), colours);
    let map = open(&path).unwrap();
    let patch = map
        .read(WindowPx::new(-246.0, -251.0, 512.0, 512.0), 512, 512)
        .unwrap();
    assert_eq!(patch.valid.iter().filter(|&&v| v == 255).count(), 200);
    assert_eq!(patch.rgb.get_pixel(246 + 7, 251 + 3).0, colours(7, 3));
    assert_eq!(patch.rgb.get_pixel(0, 0).0, [0, 0, 0]);
    let outside = map
        .read(WindowPx::new(1e6, -1e6, 64.0, 64.0), 32, 32)
        .unwrap();
    assert!(outside.valid.iter().all(|&v| v == 0));
}

#[test]
fn windows_that_cannot_be_read_are_refused() {
    let dir = folder();
    let path = dir.path().join("map.tif");
    write_map(&path, (20, 10), geo_tags(32651), colours);
    let map = open(&path).unwrap();
    for (window, w, h) in [
        (WindowPx::new(f64::NAN, 0.0, 5.0, 5.0), 5, 5),
        (WindowPx::new(0.0, 0.0, 0.0, 5.0), 5, 5),
        (WindowPx::new(0.0, 0.0, -5.0, 5.0), 5, 5),
        (WindowPx::new(0.0, 0.0, 5.0, 5.0), 0, 5),
        (WindowPx::new(0.0, 0.0, 5.0, 5.0), 100_000, 100_000),
        (WindowPx::new(1e300, 0.0, 5.0, 5.0), 5, 5),
        // The filter would take hours to evaluate.
        (WindowPx::new(-1e9, -1e9, 2e9, 2e9), 5, 5),
        (WindowPx::new(0.0, 0.0, 5.0, 9e11), 640, 640),
    ] {
        let error = map.read(window, w, h).unwrap_err();
        assert!(matches!(error, GeoError::BadWindow { .. }), "{error}");
    }
}

#[test]
fn truncated_files_are_refused_when_they_are_opened() {
    let dir = folder();
    for name in [
        "tiled_jpeg_ycbcr.tif",
        "striped_lzw_one_row.tif",
        "cog.tif",
        "packbits_bigtiff.tif",
    ] {
        let bytes = std::fs::read(golden_map(name)).unwrap();
        let path = dir.path().join(name);
        for share in [0.03, 0.3, 0.6, 0.98] {
            std::fs::write(&path, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
            let error = refused(open(&path), &path, &[]);
            assert!(
                matches!(error, GeoError::Truncated { .. } | GeoError::Damaged { .. }),
                "{name} {share}: {error:?}"
            );
            assert!(
                error.to_string().contains("copy or download it again"),
                "{error}"
            );
        }
    }
    // Pictures are decoded when they are read.
    for name in ["map.png", "map.jpg"] {
        let path = dir.path().join(name);
        picture(&path, 200, 200);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
        let map = with_corners(&path, [120.0, 24.0, 120.002, 24.0018]).unwrap();
        let error = map
            .read(WindowPx::new(0.0, 0.0, 9.0, 9.0), 9, 9)
            .unwrap_err();
        assert!(matches!(error, GeoError::Damaged { .. }), "{error:?}");
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn damaged_blocks_are_an_error_that_names_the_file() {
    let dir = folder();
    let mut bytes = std::fs::read(golden_map("tiled_deflate_predictor.tif")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 1000].fill(0xAA);
    let path = dir.path().join("damaged.tif");
    std::fs::write(&path, bytes).unwrap();
    let error = match open(&path) {
        Err(error) => error,
        Ok(map) => map
            .read(WindowPx::new(0.0, 0.0, 96.0, 80.0), 96, 80)
            .unwrap_err(),
    };
    assert!(error.to_string().contains("damaged.tif"), "{error}");
}

#[test]
fn what_is_not_a_picture_is_refused() {
    let dir = folder();
    for (name, bytes) in [
        ("text.tif", &b"hello, this is not a map"[..]),
        ("empty.tif", &b""[..]),
        ("short.jpg", &b"\xFF\xD8"[..]),
        ("page.png", &b"<html></html>"[..]),
    ] {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = refused(open(&path), &path, &[]);
        assert!(
            matches!(error, GeoError::NotAMap { .. } | GeoError::Damaged { .. }),
            "{error:?}"
        );
    }
    let path = dir.path().join("absent.tif");
    assert!(matches!(
        refused(open(&path), &path, &[]),
        GeoError::Io { .. }
    ));
    let path = dir.path().to_path_buf();
    assert!(matches!(
        refused(open(&path), &path, &[]),
        GeoError::Io { .. }
    ));
}

#[test]
fn decompression_bombs_are_refused_before_they_are_decoded() {
    let dir = folder();
    // A PNG header that promises 10^9 pixels a side.
    let path = dir.path().join("bomb.png");
    picture(&path, 2, 2);
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[16..24].copy_from_slice(&[0x3B, 0x9A, 0xCA, 0, 0x3B, 0x9A, 0xCA, 0]);
    std::fs::write(&path, bytes).unwrap();
    refused(with_corners(&path, [120.0, 24.0, 120.1, 24.1]), &path, &[]);
    // A TIFF whose one compressed strip would be 7 GB.
    let path = dir.path().join("bomb.tif");
    let mut tags = rgb_tags(50_000, 50_000);
    tags[3] = short(259, &[8]);
    tags.extend(geo_tags(32651));
    tags.extend([
        long8(273, &[4096]),
        long(278, &[50_000]),
        long8(279, &[1000]),
    ]);
    write_bigtiff(&path, tags, 8192);
    let map = open(&path).unwrap();
    let error = map
        .read(WindowPx::new(0.0, 0.0, 9.0, 9.0), 9, 9)
        .unwrap_err();
    assert!(matches!(error, GeoError::Unsupported { .. }), "{error:?}");
    assert!(error.to_string().contains("gdal_translate"), "{error}");
    // No pixels at all.
    let path = dir.path().join("nothing.tif");
    let mut tags = rgb_tags(0, 0);
    tags.extend(geo_tags(32651));
    tags.extend([long8(273, &[4096]), long(278, &[1]), long8(279, &[0])]);
    write_bigtiff(&path, tags, 8192);
    refused(open(&path), &path, &[]);
}

#[test]
fn grey_alpha_and_16_bit_pictures_are_read() {
    let dir = folder();
    let corners = [120.0, 24.0, 120.002, 24.0018];
    let path = dir.path().join("grey.png");
    GrayImage::from_fn(20, 20, |x, _| Luma([x as u8 * 10]))
        .save(&path)
        .unwrap();
    let patch = with_corners(&path, corners)
        .unwrap()
        .read(WindowPx::new(0.0, 0.0, 20.0, 20.0), 20, 20)
        .unwrap();
    assert_eq!(patch.rgb.get_pixel(7, 3).0, [70, 70, 70]);

    let path = dir.path().join("alpha.png");
    RgbaImage::from_fn(20, 20, |x, _| Rgba([9, 8, 7, if x < 5 { 0 } else { 255 }]))
        .save(&path)
        .unwrap();
    let patch = with_corners(&path, corners)
        .unwrap()
        .read(WindowPx::new(0.0, 0.0, 20.0, 20.0), 20, 20)
        .unwrap();
    assert_eq!(
        (patch.valid.get_pixel(4, 0).0, patch.valid.get_pixel(5, 0).0),
        ([0], [255])
    );
    assert_eq!(
        (patch.rgb.get_pixel(4, 0).0, patch.rgb.get_pixel(5, 0).0),
        ([0; 3], [9, 8, 7])
    );

    let path = dir.path().join("deep.png");
    image::ImageBuffer::from_fn(20, 20, |x, _| Luma([x as u16 * 257]))
        .save(&path)
        .unwrap();
    let patch = with_corners(&path, corners)
        .unwrap()
        .read(WindowPx::new(0.0, 0.0, 20.0, 20.0), 20, 20)
        .unwrap();
    assert_eq!(patch.rgb.get_pixel(7, 3).0, [7, 7, 7]);
}

#[test]
fn the_hash_is_of_all_files_of_the_map() {
    let dir = folder();
    let path = dir.path().join("map.png");
    picture(&path, 20, 10);
    std::fs::write(dir.path().join("map.pgw"), "1 0 0 -1 300000 2700000").unwrap();
    let hash = |path: &Path| {
        with_crs(path, "EPSG:32651")
            .unwrap()
            .content_hash()
            .unwrap()
    };
    let first = hash(&path);
    assert_eq!(first, hash(&path));
    std::fs::write(dir.path().join("map.pgw"), "1 0 0 -1 300001 2700000").unwrap();
    assert_ne!(first, hash(&path));
    // A file alone has the hash of its bytes.
    let tif = golden_map("grey.tif");
    let bytes = std::fs::read(&tif).unwrap();
    assert_eq!(
        open(&tif).unwrap().content_hash().unwrap(),
        *blake3::hash(&bytes).as_bytes()
    );
}

#[test]
fn reads_are_the_same_on_any_number_of_threads_and_with_any_cache() {
    let read = |threads: usize, cache_bytes: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let options = MapOptions {
                cache_bytes: Some(cache_bytes),
                ..MapOptions::default()
            };
            let map = open_map(&golden_map("u16_five_bands.tif"), &options).unwrap();
            map.read(WindowPx::new(-3.3, 2.7, 88.8, 77.7), 31, 29)
                .unwrap()
        })
    };
    let one = read(1, 0);
    assert_eq!(one, read(4, 0));
    assert_eq!(one, read(3, 1 << 20));
}

/// GeoKeys of the given model type: `(key, code)` pairs, and `(key, number)` pairs stored as doubles.
fn geokeys(shorts: &[(u16, u16)], doubles: &[(u16, f64)]) -> Vec<support::Tag> {
    let mut entries: Vec<[u16; 4]> = shorts.iter().map(|&(k, v)| [k, 0, 1, v]).collect();
    entries.extend(
        doubles
            .iter()
            .enumerate()
            .map(|(i, &(k, _))| [k, 34736, 1, i as u16]),
    );
    entries.sort_unstable();
    let mut directory = vec![1, 1, 0, entries.len() as u16];
    directory.extend(entries.concat());
    let numbers: Vec<f64> = doubles.iter().map(|&(_, v)| v).collect();
    let mut tags = vec![short(34735, &directory)];
    if !numbers.is_empty() {
        tags.push(double(34736, &numbers));
    }
    tags
}

/// A map of 20 x 10 pixels with this pixel size and origin.
fn placed_map(path: &Path, pixel: f64, origin: [f64; 2], keys: Vec<support::Tag>) {
    let mut tags = keys;
    tags.push(double(33550, &[pixel, pixel, 0.0]));
    tags.push(double(33922, &[0.0, 0.0, 0.0, origin[0], origin[1], 0.0]));
    write_map(path, (20, 10), tags, colours);
}

/// Keys of a geographic CRS on the ellipsoid of WGS 84 in an angular unit (EPSG code), and its size in radians.
fn geographic_keys(unit: u16, size_rad: Option<f64>) -> Vec<support::Tag> {
    let mut numbers = vec![(2057, 6_378_137.0), (2059, 298.257_223_563)];
    numbers.extend(size_rad.map(|size| (2055, size)));
    geokeys(
        &[
            (1024, 2),
            (1025, 1),
            (2048, 32767),
            (2050, 6326),
            (2054, unit),
            (2056, 32767),
        ],
        &numbers,
    )
}

#[test]
fn angular_units_other_than_degrees_are_converted() {
    let dir = folder();
    let expected = LonLat::new(2.25, 48.6);
    let grad = std::f64::consts::PI / 200.0;
    let units = [
        (9102, None, 1.0),
        (9101, None, 180.0 / std::f64::consts::PI),
        (9105, None, 0.9),
        (9106, None, 0.9),
        (9103, None, 1.0 / 60.0),
        (9104, None, 1.0 / 3600.0),
        (32767, Some(grad), 0.9),
    ];
    for (unit, size_rad, degrees) in units {
        let path = dir.path().join(format!("unit{unit}.tif"));
        let origin = [expected.lon_deg / degrees, expected.lat_deg / degrees];
        placed_map(
            &path,
            1e-5 / degrees,
            origin,
            geographic_keys(unit, size_rad),
        );
        let map = open(&path).unwrap();
        let found = map
            .georeference()
            .lonlat_from_map_px(MapPx::new(0.0, 0.0))
            .unwrap();
        assert!(distance_m(found, expected) < 1e-3, "unit {unit}: {found:?}");
        let (x_m, y_m) = map
            .georeference()
            .ground_resolution_m(MapPx::new(10.0, 5.0))
            .unwrap();
        assert!(
            (x_m - 0.737).abs() < 0.01 && (y_m - 1.112).abs() < 0.01,
            "unit {unit}: {x_m} {y_m}"
        );
    }
    // Degrees, minutes and seconds in one number cannot be scaled; a unit needs its size.
    for (unit, words) in [(9107, "9107"), (32767, "without a positive size")] {
        let path = dir.path().join(format!("refused{unit}.tif"));
        placed_map(&path, 1e-5, [2.0, 48.0], geographic_keys(unit, None));
        refused(open(&path), &path, &[words]);
    }
}

#[test]
fn coordinate_systems_in_grads_are_not_read_as_degrees() {
    let dir = folder();
    let path = dir.path().join("grads.tif");
    let keys = |code: u16, unit: Option<u16>| {
        let mut shorts = vec![(1024, 2), (1025, 1), (2048, code)];
        shorts.extend(unit.map(|unit| (2054, unit)));
        geokeys(&shorts, &[])
    };
    // NTF (Paris), with and without its unit.
    for unit in [None, Some(9105)] {
        placed_map(&path, 1e-5, [2.5, 54.0], keys(4807, unit));
        refused(open(&path), &path, &["grads"]);
    }
    // WGS 84 that is said to be in grads.
    placed_map(&path, 1e-5, [2.5, 54.0], keys(4326, Some(9105)));
    refused(open(&path), &path, &["EPSG:4326", "GeogAngularUnitsGeoKey"]);
    assert!(grimnet_geo::Crs::parse("EPSG:4807").is_err());
}

#[test]
fn angles_of_a_projection_are_read_in_their_unit() {
    let dir = folder();
    // A transverse Mercator projection about 3 degrees east, its parameters in grads.
    let keys = |unit: u16, per_degree: f64| {
        geokeys(
            &[
                (1024, 1),
                (1025, 1),
                (2048, 4326),
                (2054, unit),
                (3072, 32767),
                (3074, 32767),
                (3075, 1),
                (3076, 9001),
            ],
            &[
                (3080, 3.0 * per_degree),
                (3081, 45.0 * per_degree),
                (3082, 500_000.0),
                (3083, 0.0),
                (3092, 1.0),
            ],
        )
    };
    for (unit, per_degree) in [(9102, 1.0), (9105, 1.0 / 0.9)] {
        let path = dir.path().join(format!("tmerc{unit}.tif"));
        placed_map(&path, 0.5, [500_000.0, 0.0], keys(unit, per_degree));
        let map = open(&path).unwrap();
        let found = map
            .georeference()
            .lonlat_from_map_px(MapPx::new(0.0, 0.0))
            .unwrap();
        assert!(
            distance_m(found, LonLat::new(3.0, 45.0)) < 1e-3,
            "unit {unit}: {found:?}"
        );
    }
}

#[test]
fn a_linear_unit_that_contradicts_the_code_is_refused() {
    let dir = folder();
    let path = dir.path().join("feet.tif");
    let keys = |unit: u16| geokeys(&[(1024, 1), (1025, 1), (3072, 32651), (3076, unit)], &[]);
    placed_map(&path, 0.5, [300_000.0, 2_700_000.0], keys(9001));
    open(&path).unwrap();
    // UTM is in metres: the same numbers in US survey feet are elsewhere.
    placed_map(&path, 0.5, [300_000.0, 2_700_000.0], keys(9003));
    refused(open(&path), &path, &["EPSG:32651", "ProjLinearUnitsGeoKey"]);
    placed_map(&path, 0.5, [300_000.0, 2_700_000.0], keys(9096));
    refused(open(&path), &path, &["EPSG:9096"]);
}
