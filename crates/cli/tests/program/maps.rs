//! Maps before they are built, and answers for QGIS.

use super::*;

#[test]
fn a_map_is_checked_before_it_is_built() {
    let map = demo().join("map.tif");
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("map.png");
    let output = grim()
        .args(["map", "check", "--json", "--draw"])
        .args([&picture, &map])
        .output()
        .unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{report}");
    assert_eq!(report["concerns"], serde_json::json!([]));
    assert!(report["build_s"].as_f64().unwrap() > 0.0);
    let built = std::fs::metadata(pack()).unwrap().len();
    let expected = report["pack_bytes"].as_u64().unwrap();
    assert!(
        (built / 2..built * 2).contains(&expected),
        "{expected} {built}"
    );
    assert!(image::open(&picture).unwrap().width() > 100);
    // A picture is not replaced, and the map never.
    for (out, words) in [(&picture, "--overwrite"), (&map, "input")] {
        grim()
            .args(["map", "check", "--draw"])
            .args([out, &map])
            .assert()
            .code(2)
            .stderr(contains(words));
    }
    // Half of it black.
    let mut half = image::open(&picture).unwrap().into_rgb8();
    for (x, _, pixel) in half.enumerate_pixels_mut() {
        if x % 2 == 0 {
            *pixel = image::Rgb([0; 3]);
        }
    }
    let black = folder.path().join("black.png");
    half.save(&black).unwrap();
    grim()
        .args(["map", "check", "--corners", "13.40,52.50,13.41,52.506"])
        .arg(&black)
        .assert()
        .code(1)
        .stdout(contains("black").and(contains("warning")));
    grim()
        .args(["map", "check"])
        .arg(folder.path())
        .assert()
        .code(2)
        .stderr(contains(
            "neither tiles ({zoom}/{column}/{row}.png) nor GeoTIFFs",
        ));
    // Across the antimeridian.
    let fiji = ["--corners", "179.996,-16.503,-179.996,-16.5"];
    grim()
        .args(["map", "check"])
        .args(fiji)
        .arg(&picture)
        .assert()
        .stdout(contains(
            "extent   179.996000 to 180.004000 east, -16.503000 to -16.500000 north; 0.85",
        ));
    let output = grim()
        .args(["map", "check", "--json"])
        .args(fiji)
        .arg(&picture)
        .output()
        .unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let [west, east] = [0, 2].map(|i| report["bounds_deg"][i].as_f64().unwrap());
    assert!(
        (west - 179.996).abs() < 1e-9 && (east - 180.004).abs() < 1e-9,
        "{west} {east}"
    );
}

#[cfg(feature = "sqlite")]
#[test]
fn a_name_that_ends_in_gpkg_asks_for_a_geopackage() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("fixes.gpkg");
    let arguments = ["-o", out.to_str().unwrap()];
    let (_, status) = locate(&arguments, &[photo(1), photo(2)]);
    assert_eq!(status, 0);
    let bytes = std::fs::read(&out).unwrap();
    assert!(bytes.starts_with(b"SQLite format 3\0"));
    assert_eq!(&bytes[68..72], b"GPKG");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    // A file of others is not replaced; standard output takes no database.
    let (_, status) = locate(&arguments, &[photo(1)]);
    assert_eq!(status, 2);
    let (text, status) = locate(&["--format", "gpkg"], &[photo(1)]);
    assert_eq!((text.as_str(), status), ("", 2));
}
