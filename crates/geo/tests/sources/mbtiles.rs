//! MBTiles.

use std::path::PathBuf;

use grimnet_geo::{MapOptions, WindowPx, open_map};

use crate::gdal::{check, copy_of, open, path_of, refused};

#[test]
fn mbtiles_are_what_gdal_reads() {
    for name in ["town.mbtiles", "mixed.mbtiles"] {
        check(name, open(name).as_ref(), name);
    }
}

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

#[test]
fn names_with_characters_of_uris_are_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a?mode=rw#50%.mbtiles");
    std::fs::copy(path_of("town.mbtiles"), &path).unwrap();
    assert!(open_map(&path, &MapOptions::default()).is_ok());
}

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

/// Runs statements on a copy of a file whose rows are counted from the south.
fn changed(statements: &str) -> (tempfile::TempDir, PathBuf) {
    let (dir, path) = copy_of("town.mbtiles");
    let base = rusqlite::Connection::open(&path).unwrap();
    base.execute_batch(statements).unwrap();
    (dir, path)
}

const FLIP: &str = "UPDATE tiles SET tile_row = (1 << zoom_level) - 1 - tile_row;";
const STATE_XYZ: &str = "INSERT INTO metadata VALUES ('scheme', 'xyz');";

#[test]
fn rows_on_the_other_side_of_the_equator_are_refused() {
    let (_dir, path) = changed(FLIP);
    let error = refused(&path).to_string();
    assert!(
        error.contains("counted from the other side") && error.contains("'scheme', 'xyz'"),
        "{error}"
    );
}

#[test]
fn rows_that_are_said_to_be_counted_from_the_north_are_if_the_bounds_agree() {
    let (_dir, path) = changed(&format!("{FLIP}{STATE_XYZ}"));
    let map = open_map(&path, &MapOptions::default()).unwrap();
    check("from the north", map.as_ref(), "town.mbtiles");
    assert_eq!(map.caveats(), [""; 0]);
    // Some writers state it of rows from the south.
    let (_dir, path) = changed(STATE_XYZ);
    let map = open_map(&path, &MapOptions::default()).unwrap();
    check("from the south", map.as_ref(), "town.mbtiles");
    assert_eq!(map.caveats(), [""; 0]);
    let (_dir, path) = changed(&format!(
        "{STATE_XYZ}DELETE FROM metadata WHERE name = 'bounds';"
    ));
    let map = open_map(&path, &MapOptions::default()).unwrap();
    check("without bounds", map.as_ref(), "town.mbtiles");
    let caveats = map.caveats().join("\n");
    assert!(
        caveats.contains("read as counted from the south"),
        "{caveats}"
    );
}

/// A map of one column of tiles at zoom 10, in these rows counted from the north, that states `scheme` `xyz` and these bounds.
fn xyz_rows(rows: std::ops::Range<u32>, bounds: &str) -> (f64, String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rows.mbtiles");
    let base = rusqlite::Connection::open(&path).unwrap();
    base.execute_batch(&format!(
        "CREATE TABLE metadata (name TEXT, value TEXT);
         CREATE TABLE tiles (zoom_level INTEGER, tile_column INTEGER, tile_row INTEGER, tile_data BLOB);
         {STATE_XYZ} INSERT INTO metadata VALUES ('bounds', '{bounds}');"
    ))
    .unwrap();
    let mut tile = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(256, 256, image::Rgb([90, 80, 70]))
        .write_to(&mut tile, image::ImageFormat::Png)
        .unwrap();
    for row in rows {
        base.execute(
            "INSERT INTO tiles VALUES (10, 289, ?1, ?2)",
            rusqlite::params![row, tile.get_ref()],
        )
        .unwrap();
    }
    drop(base);
    let map = open_map(&path, &MapOptions::default()).unwrap();
    let [_, south, _, _] = map.georeference().bounds_deg().unwrap();
    (south, map.caveats().join("\n"))
}

/// Quito: a tile of zoom 10 has 0.3516 degrees there.
#[test]
fn bounds_of_a_map_across_the_equator_show_the_rows_too() {
    let (south, caveats) = xyz_rows(511..514, "-78.4,-0.7031,-78.0,0.3516");
    assert!((south + 0.7031).abs() < 1e-3, "{south}");
    assert_eq!(caveats, "");
    // Those of the whole world show nothing.
    let (south, caveats) = xyz_rows(511..514, "-180,-85,180,85");
    assert!((south + 0.3516).abs() < 1e-3, "{south}");
    assert!(
        caveats.contains("read as counted from the south"),
        "{caveats}"
    );
}
