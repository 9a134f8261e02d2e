//! MBTiles.

use grimnet_geo::{MapOptions, WindowPx, concerns, open_map, overview};

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

#[test]
fn rows_counted_from_the_north_look_flipped() {
    let (_dir, path) = copy_of("town.mbtiles");
    let caveats = |path: &std::path::Path| {
        let map = open_map(path, &MapOptions::default()).unwrap();
        let picture = overview(map.as_ref()).unwrap();
        let concerns = concerns(map.as_ref(), &picture).unwrap();
        let texts: Vec<String> = concerns.iter().map(ToString::to_string).collect();
        texts.join("\n")
    };
    assert!(!caveats(&path).contains("flipped"), "{}", caveats(&path));
    let base = rusqlite::Connection::open(&path).unwrap();
    base.execute_batch("UPDATE tiles SET tile_row = (1 << zoom_level) - 1 - tile_row")
        .unwrap();
    drop(base);
    let caveats = caveats(&path);
    assert!(caveats.contains("its rows look flipped"), "{caveats}");
    assert!(
        caveats.contains("rows counted from the south (TMS)"),
        "{caveats}"
    );
}
