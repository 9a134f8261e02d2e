//! Maps of tiles and of several pictures, against GDAL (`sources/make_sources.py`).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use grimnet_geo::{GeoError, LonLat, MapOptions, MapPx, Raster, WindowPx, distance_m, open_map};
use serde_json::Value;

/// JPEG decoders differ by this much.
const JPEG_TOLERANCE: u8 = 6;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/sources")
}

fn path_of(name: &str) -> PathBuf {
    folder().join("maps").join(name)
}

fn open(name: &str) -> Box<dyn Raster> {
    open_map(&path_of(name), &MapOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn refused(path: &Path) -> GeoError {
    match open_map(path, &MapOptions::default()) {
        Ok(map) => panic!("{} was opened: {}", path.display(), map.describe()),
        Err(error) => error,
    }
}

fn golden(file: &str) -> Value {
    let text = std::fs::read(folder().join("golden.json")).unwrap();
    let golden: Value = serde_json::from_slice(&text).unwrap();
    let maps = golden["maps"].as_array().unwrap().clone();
    maps.into_iter().find(|m| m["file"] == file).unwrap()
}

/// Compares place, size and pixels with GDAL's of `file`.
fn check(name: &str, map: &dyn Raster, file: &str) {
    let golden = golden(file);
    let number = |value: &Value| value.as_f64().unwrap();
    let size = &golden["size_px"];
    assert_eq!(
        map.size_px(),
        (number(&size[0]) as u64, number(&size[1]) as u64),
        "{name}"
    );
    for point in golden["points"].as_array().unwrap() {
        let px = MapPx::new(number(&point["x_px"]), number(&point["y_px"]));
        let truth = LonLat::new(number(&point["lon_deg"]), number(&point["lat_deg"]));
        let ours = map.georeference().lonlat_from_map_px(px).unwrap();
        let off_m = distance_m(ours, truth);
        assert!(off_m < 1e-3, "{name} {px:?}: {off_m} m from {truth:?}");
    }
    for entry in golden["windows"].as_array().unwrap() {
        let [x, y, w, h] = [0, 1, 2, 3].map(|i| number(&entry["window"][i]));
        let patch = map
            .read(WindowPx::new(x, y, w, h), w as u32, h as u32)
            .unwrap();
        let picture = folder()
            .join("expected")
            .join(entry["expected"].as_str().unwrap());
        let expected = image::open(&picture).unwrap().to_rgba8();
        for (column, row, truth) in expected.enumerate_pixels() {
            let ours = patch.rgb.get_pixel(column, row).0;
            let off = (0..3).map(|i| ours[i].abs_diff(truth.0[i])).max().unwrap();
            assert!(
                off <= JPEG_TOLERANCE,
                "{name} window {x} {y}, pixel {column} {row}: {ours:?}, GDAL has {truth:?}"
            );
            if golden["has_mask"] == true {
                let seen = patch.valid.get_pixel(column, row).0[0];
                assert_eq!(
                    seen, truth.0[3],
                    "{name} window {x} {y}, pixel {column} {row}"
                );
            }
        }
    }
}

/// A copy of a folder of maps, to be changed.
fn copy_of(name: &str) -> (tempfile::TempDir, PathBuf) {
    fn copy(from: &Path, to: &Path) {
        if from.is_dir() {
            std::fs::create_dir(to).unwrap();
            for entry in std::fs::read_dir(from).unwrap() {
                let entry = entry.unwrap();
                copy(&entry.path(), &to.join(entry.file_name()));
            }
        } else {
            std::fs::copy(from, to).unwrap();
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    copy(&path_of(name), &path);
    (dir, path)
}

#[test]
fn tiles_are_what_gdal_reads() {
    for name in ["town_xyz", "town_tms", "town.pmtiles"] {
        check(name, open(name).as_ref(), "town.mbtiles");
    }
}

#[cfg(feature = "mbtiles")]
#[test]
fn mbtiles_are_what_gdal_reads() {
    for name in ["town.mbtiles", "mixed.mbtiles"] {
        check(name, open(name).as_ref(), name);
    }
}

#[test]
fn coarser_zooms_are_overviews() {
    let map = open("town_xyz");
    // A quarter of the size: 24 squares of GDAL's averages instead of the finest zoom.
    let quarter = map
        .read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 192, 192)
        .unwrap();
    let (_dir, only_finest) = copy_of("town_xyz");
    for zoom in ["15", "16"] {
        std::fs::remove_dir_all(only_finest.join(zoom)).unwrap();
    }
    let finest = open_map(&only_finest, &MapOptions::default()).unwrap();
    assert!(map.describe().contains("2 overviews"), "{}", map.describe());
    assert!(finest.describe().contains("0 overviews"));
    let averaged = finest
        .read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 192, 192)
        .unwrap();
    // Grey values that the two differ by, on average, if one is shifted.
    let difference = |right: u32, down: u32| {
        let (mut sum, mut count) = (0.0, 0.0);
        for (x, y) in (0..191).flat_map(|y| (0..191).map(move |x| (x, y))) {
            let (other_x, other_y) = (x + right, y + down);
            if quarter.valid.get_pixel(x, y).0[0] == 0
                || averaged.valid.get_pixel(other_x, other_y).0[0] == 0
            {
                continue;
            }
            let ours = quarter.rgb.get_pixel(x, y).0;
            let other = averaged.rgb.get_pixel(other_x, other_y).0;
            sum += (0..3)
                .map(|i| f64::from(ours[i].abs_diff(other[i])))
                .sum::<f64>();
            count += 3.0;
        }
        sum / count
    };
    // Box and triangle filters differ at the edges of squares.
    let in_place = difference(0, 0);
    for shifted in [difference(1, 0), difference(0, 1)] {
        assert!(in_place < 0.5 * shifted, "{in_place} {shifted}");
    }
}

#[test]
fn a_zoom_that_covers_less_than_its_overview_says_has_fewer_levels() {
    let (_dir, path) = copy_of("town_xyz");
    let column = std::fs::read_dir(path.join("16")).unwrap().next().unwrap();
    std::fs::remove_dir_all(column.unwrap().path()).unwrap();
    let map = open_map(&path, &MapOptions::default()).unwrap();
    assert!(map.describe().contains("0 overviews"), "{}", map.describe());
}

#[test]
fn a_zoom_can_be_chosen() {
    let at = |zoom| {
        let options = MapOptions {
            zoom: Some(zoom),
            ..MapOptions::default()
        };
        open_map(&path_of("town_xyz"), &options)
    };
    let coarse = at(16).unwrap();
    let fine = open("town_xyz");
    let centre = coarse.georeference().centre_px();
    let (x_m, y_m) = coarse.georeference().ground_resolution_m(centre).unwrap();
    // 156543.03 m * cos(latitude) / 2^zoom on the sphere; the ellipsoid differs by less than 0.7 %.
    let lat = coarse
        .georeference()
        .lonlat_from_map_px(centre)
        .unwrap()
        .lat_deg;
    let sphere_m = 156_543.033_928 * lat.to_radians().cos() / f64::from(1 << 16);
    assert!((x_m / sphere_m - 1.0).abs() < 7e-3, "{x_m} {sphere_m}");
    assert!((y_m / sphere_m - 1.0).abs() < 7e-3, "{y_m} {sphere_m}");
    assert_ne!(coarse.content_hash().unwrap(), fine.content_hash().unwrap());
    let error = at(12).err().unwrap().to_string();
    assert!(error.contains("zooms 15, 16, 17"), "{error}");
}

#[test]
fn half_as_many_pixels_a_tile_are_twice_as_large_on_the_ground() {
    let dir = tempfile::tempdir().unwrap();
    let resolution_m = |px: u32| {
        let folder = dir.path().join(px.to_string()).join("17/69541");
        std::fs::create_dir_all(&folder).unwrap();
        image::RgbImage::from_pixel(px, px, image::Rgb([9, 9, 9]))
            .save(folder.join("46101.png"))
            .unwrap();
        let map = open_map(&dir.path().join(px.to_string()), &MapOptions::default()).unwrap();
        let georeference = map.georeference();
        let (x_m, _) = georeference
            .ground_resolution_m(georeference.centre_px())
            .unwrap();
        x_m
    };
    let (small_m, large_m) = (resolution_m(256), resolution_m(512));
    assert!(
        (small_m / large_m - 2.0).abs() < 1e-6,
        "{small_m} {large_m}"
    );
}

#[test]
fn the_hash_changes_with_each_tile_and_its_place() {
    let (_dir, path) = copy_of("town_xyz");
    let hash = |path: &Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        map.content_hash().unwrap()
    };
    let first = hash(&path);
    assert_eq!(
        first,
        hash(&path_of("town_xyz")),
        "of the tiles alone, not of their folder"
    );
    // Files that are no tiles do not count.
    std::fs::write(path.join("readme.txt"), "x").unwrap();
    assert_eq!(first, hash(&path));
    let column = path.join("17/69541");
    std::fs::rename(column.join("46101.png"), column.join("46100.png")).unwrap();
    assert_ne!(first, hash(&path));
    let pmtiles = open("town.pmtiles").content_hash().unwrap();
    let bytes = std::fs::read(path_of("town.pmtiles")).unwrap();
    assert_eq!(pmtiles, *blake3::hash(&bytes).as_bytes());
}

#[cfg(feature = "mbtiles")]
#[test]
fn mbtiles_are_not_written_to() {
    let (dir, path) = copy_of("town.mbtiles");
    let before = std::fs::read(&path).unwrap();
    let map = open_map(&path, &MapOptions::default()).unwrap();
    map.read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 96, 96)
        .unwrap();
    let names: Vec<_> = std::fs::read_dir(dir.path())
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(names, ["town.mbtiles"], "while it is open");
    drop(map);
    assert_eq!(before, std::fs::read(&path).unwrap());
    // A journal with changes that the file does not have yet.
    std::fs::write(dir.path().join("town.mbtiles-wal"), "frames").unwrap();
    let error = refused(&path).to_string();
    assert!(error.contains("was not closed"), "{error}");
}

#[cfg(feature = "mbtiles")]
#[test]
fn other_databases_are_refused() {
    for (name, words) in [
        ("vector.mbtiles", "vector tiles"),
        ("raster.gpkg", "gdal_translate"),
        ("other.sqlite", "without the table 'tiles'"),
    ] {
        let error = refused(&path_of(name)).to_string();
        assert!(error.contains(words) && error.contains(name), "{error}");
    }
}

#[cfg(feature = "mbtiles")]
#[test]
fn names_with_characters_of_uris_are_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a?mode=rw#50%.mbtiles");
    std::fs::copy(path_of("town.mbtiles"), &path).unwrap();
    assert!(open_map(&path, &MapOptions::default()).is_ok());
}

#[cfg(feature = "mbtiles")]
#[test]
fn a_view_that_never_ends_is_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("endless.mbtiles");
    let base = rusqlite::Connection::open(&path).unwrap();
    base.execute_batch(
        "CREATE TABLE metadata (name TEXT, value TEXT);
         CREATE VIEW tiles AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)
         SELECT i AS zoom_level, 0 AS tile_column, 0 AS tile_row, x'00' AS tile_data FROM n WHERE i < 0;",
    )
    .unwrap();
    drop(base);
    let error = refused(&path).to_string();
    assert!(error.contains("more steps"), "{error}");
}

#[test]
fn vector_pmtiles_are_refused() {
    let error = refused(&path_of("vector.pmtiles")).to_string();
    assert!(error.contains("vector tiles"), "{error}");
}

#[test]
fn what_is_wrong_with_a_tile_is_said() {
    let replace = |bytes: &[u8]| {
        let (_dir, path) = copy_of("town_xyz");
        std::fs::write(path.join("17/69542/46102.png"), bytes).unwrap();
        let map = open_map(&path, &MapOptions::default()).unwrap();
        map.read(WindowPx::new(0.0, 0.0, 768.0, 768.0), 768, 768)
            .unwrap_err()
            .to_string()
    };
    let mut small = Vec::new();
    image::RgbImage::new(128, 128)
        .write_to(
            &mut std::io::Cursor::new(&mut small),
            image::ImageFormat::Png,
        )
        .unwrap();
    for (bytes, words) in [
        (&b""[..], "it is empty"),
        (b"<html>429 Too Many Requests</html>", "error page"),
        (&small, "128 x 128 pixels, where others have 256 x 256"),
    ] {
        let error = replace(bytes);
        assert!(
            error.contains(words) && error.contains("17/69542/46102"),
            "{error}"
        );
    }
}

#[test]
fn folders_of_other_things_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let error = refused(dir.path()).to_string();
    assert!(error.contains("neither folders of zooms"), "{error}");
    let tile = dir.path().join("17/3/200000.png");
    std::fs::create_dir_all(tile.parent().unwrap()).unwrap();
    std::fs::copy(path_of("town_xyz/17/69541/46101.png"), tile).unwrap();
    let error = refused(dir.path()).to_string();
    assert!(error.contains("no tile at column 3, row 200000"), "{error}");
}

#[test]
fn a_tile_in_two_formats_is_refused() {
    let (_dir, path) = copy_of("town_xyz");
    let column = path.join("17/69541");
    std::fs::copy(column.join("46101.png"), column.join("46101.jpg")).unwrap();
    let error = refused(&path).to_string();
    assert!(error.contains("two pictures"), "{error}");
}

#[cfg(unix)]
#[test]
fn links_in_circles_end() {
    let (_dir, path) = copy_of("town_xyz");
    std::os::unix::fs::symlink(&path, path.join("18")).unwrap();
    std::os::unix::fs::symlink(path.join("17"), path.join("17/69541/46104.png")).unwrap();
    // Zoom 18 has the columns 15 to 18, whose files are no tiles.
    let map = open_map(&path, &MapOptions::default()).unwrap();
    assert!(map.describe().contains("zoom 17"), "{}", map.describe());
}

#[test]
fn a_finest_zoom_of_a_small_part_is_said() {
    let (_dir, path) = copy_of("town_xyz");
    // Zoom 17 over an area of 32 x 32 of its tiles, zoom 18 in one of them.
    let tile = path.join("17/69541/46101.png");
    for column in 69541..69573 {
        let folder = path.join(format!("17/{column}"));
        std::fs::create_dir_all(&folder).unwrap();
        for row in 46101..46133 {
            if !folder.join(format!("{row}.png")).exists() {
                std::fs::hard_link(&tile, folder.join(format!("{row}.png"))).unwrap();
            }
        }
    }
    assert!(
        open_map(&path, &MapOptions::default())
            .unwrap()
            .caveats()
            .is_empty()
    );
    let finer = path.join("18/139082");
    std::fs::create_dir_all(&finer).unwrap();
    std::fs::copy(&tile, finer.join("92202.png")).unwrap();
    let map = open_map(&path, &MapOptions::default()).unwrap();
    let caveats = map.caveats().join("\n");
    assert!(caveats.contains("choose zoom 17"), "{caveats}");
}

#[test]
fn vrts_are_what_gdal_reads() {
    for name in ["parts.vrt", "nodata.vrt", "cut.vrt"] {
        check(name, open(name).as_ref(), name);
    }
}

#[test]
fn lists_and_folders_of_geotiffs_are_the_vrt_of_them() {
    check("parts.txt", open("parts.txt").as_ref(), "parts.vrt");
    let dir = tempfile::tempdir().unwrap();
    for part in 0..4 {
        let name = format!("part_{part}.tif");
        std::fs::copy(path_of(&name), dir.path().join(name)).unwrap();
    }
    let map = open_map(dir.path(), &MapOptions::default()).unwrap();
    check("folder", map.as_ref(), "parts.vrt");
    // The order matters, and each file's bytes.
    let hash = |path: &Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        map.content_hash().unwrap()
    };
    let before = hash(dir.path());
    std::fs::rename(dir.path().join("part_0.tif"), dir.path().join("part_9.tif")).unwrap();
    assert_ne!(before, hash(dir.path()));
}

#[test]
fn seams_of_reduced_mosaics_have_no_holes() {
    // Pictures whose edges lie on no even pixel.
    let map = open("parts.txt");
    for side in [37, 52, 110] {
        let inner = WindowPx::new(30.0, 30.0, 160.0, 80.0);
        let patch = map.read(inner, side, side / 2).unwrap();
        let holes = patch.valid.pixels().filter(|p| p.0[0] == 0).count();
        assert_eq!(holes, 0, "{side}");
    }
}

#[test]
fn what_a_vrt_does_beyond_putting_pictures_together_is_refused() {
    let error = refused(&path_of("warped.vrt")).to_string();
    assert!(
        error.contains("VRTWarpedDataset") && error.contains("gdal_translate"),
        "{error}"
    );
    let text = std::fs::read_to_string(path_of("parts.vrt")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    for part in 0..4 {
        let name = format!("part_{part}.tif");
        std::fs::copy(path_of(&name), dir.path().join(name)).unwrap();
    }
    let path = dir.path().join("changed.vrt");
    let changed = |from: &str, to: &str| {
        assert!(text.contains(from));
        std::fs::write(&path, text.replace(from, to)).unwrap();
        refused(&path).to_string()
    };
    for (from, to, words) in [
        (
            "SimpleSource",
            "KernelFilteredSource",
            "KernelFilteredSource",
        ),
        ("<NODATA>0</NODATA>", "<LUT>0:0,255:9</LUT>", "LUT"),
        (
            "<NODATA>0</NODATA>",
            "<NODATA>x</NODATA>",
            "'x' is no number",
        ),
        ("<SourceBand>2<", "<SourceBand>1<", "band 2"),
        (">part_0.tif<", ">/vsicurl/http://a/b.tif<", "not a file"),
        (">part_0.tif<", ">missing.tif<", "missing.tif"),
        (">part_0.tif<", ">.<", "not a file"),
        ("xSize=\"120\"", "xSize=\"1200\"", "takes more of"),
        ("xSize=\"120\"", "xSize=\"nan\"", "SrcRect"),
        ("rasterXSize=\"220\"", "rasterXSize=\"0\"", "rasterXSize"),
        ("</VRTDataset>", "", "damaged"),
        ("VRTDataset", "Other", "not a VRT"),
    ] {
        let error = changed(from, to);
        assert!(error.contains(words), "{from} -> {to}: {error}");
    }
    // Well-known text without a code: the system of the pictures.
    std::fs::write(
        &path,
        text.replace("AUTHORITY[\"EPSG\",\"32632\"]", "EXTENSION[\"x\",\"y\"]"),
    )
    .unwrap();
    check(
        "changed.vrt",
        open_map(&path, &MapOptions::default()).unwrap().as_ref(),
        "parts.vrt",
    );
}

#[test]
fn geotiffs_that_do_not_fit_together_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::copy(path_of("part_0.tif"), dir.path().join("a.tif")).unwrap();
    let other = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden/maps");
    for (name, words) in [
        ("striped_lzw_one_row.tif", "coordinate system"),
        ("rotated.tif", ""),
        ("u16_five_bands.tif", "not 8-bit"),
    ] {
        std::fs::copy(other.join(name), dir.path().join("b.tif")).unwrap();
        let error = refused(dir.path()).to_string();
        assert!(
            error.contains(words) && error.contains("b.tif"),
            "{name}: {error}"
        );
    }
    std::fs::write(dir.path().join("empty.txt"), "# nothing\n").unwrap();
    let error = refused(&dir.path().join("empty.txt")).to_string();
    assert!(error.contains("lists no GeoTIFFs"), "{error}");
}

#[test]
fn georeference_and_nodata_beside_the_file_are_used() {
    for name in ["pam.png", "pam_baseline.tif"] {
        check(name, open(name).as_ref(), name);
    }
    // It belongs to the map.
    let dir = tempfile::tempdir().unwrap();
    for name in ["pam.png", "pam.png.aux.xml"] {
        std::fs::copy(path_of(name), dir.path().join(name)).unwrap();
    }
    let path = dir.path().join("pam.png");
    let hash = |path: &Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        map.content_hash().unwrap()
    };
    let before = hash(&path);
    let sidecar = dir.path().join("pam.png.aux.xml");
    let text = std::fs::read_to_string(&sidecar).unwrap();
    std::fs::write(
        &sidecar,
        text.replace("5.2000000000000000e+06", "5.2000010000000000e+06"),
    )
    .unwrap();
    assert_ne!(before, hash(&path));
    std::fs::write(
        &sidecar,
        "<PAMDataset><GeoTransform>1, 2</GeoTransform></PAMDataset>",
    )
    .unwrap();
    let error = refused(&path).to_string();
    assert!(
        error.contains("aux.xml") && error.contains("six numbers"),
        "{error}"
    );
}
