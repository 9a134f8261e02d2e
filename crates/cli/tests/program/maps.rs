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

#[test]
fn options_without_effect_are_refused() {
    let fails = |arguments: &[&str], says: &str| {
        grim()
            .args(["map"])
            .args(arguments)
            .assert()
            .code(2)
            .stderr(contains(says));
    };
    let (pack, map) = (pack(), demo().join("map.tif"));
    let (pack, map) = (pack.to_str().unwrap(), map.to_str().unwrap());
    for (option, value) in [("--level", "9"), ("--level", "0")] {
        fails(&["info", pack, option, value], "--draw");
    }
    for (option, value) in [
        ("--crs", "EPSG:25833"),
        ("--corners", "1,2,3,4"),
        ("--zoom", "3"),
    ] {
        fails(&["info", pack, option, value], "--map");
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x.grim");
    let out = out.to_str().unwrap();
    fails(
        &["build", map, "-o", out, "--max-photo-memory", "9"],
        "--photo",
    );
}

#[test]
fn the_name_of_a_picture_is_checked_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let gif = folder.path().join("map.gif");
    let (pack, map) = (pack(), demo().join("map.tif"));
    let (pack, map) = (pack.to_str().unwrap(), map.to_str().unwrap());
    for arguments in [
        ["check", map, "--model", "/no/such.safetensors"],
        ["info", pack, "--map", "/no/such.tif"],
    ] {
        grim()
            .arg("map")
            .args(arguments)
            .arg("--draw")
            .arg(&gif)
            .assert()
            .code(2)
            .stderr(contains(".png").and(contains("no/such").not()));
    }
    assert!(!gif.exists());
}

#[cfg(unix)]
#[test]
fn a_picture_that_does_not_fit_is_named_once() {
    let folder = tempfile::tempdir().unwrap();
    let map = demo().join("map.tif");
    let script = format!(
        "trap '' XFSZ; ulimit -f 1; exec \"$GRIM\" map check {} --draw small.png",
        map.display()
    );
    let output = std::process::Command::new("bash")
        .args(["-c", &script])
        .current_dir(folder.path())
        .env("GRIM", assert_cmd::cargo::cargo_bin("grim"))
        .env("GRIM_LOG", "error")
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    for words in ["small.png", "File too large"] {
        assert_eq!(errors.matches(words).count(), 1, "{errors}");
    }
}

#[test]
fn a_pack_among_the_maps_is_warned_of_and_called_a_pack() {
    let maps = tempfile::tempdir().unwrap();
    std::fs::copy(demo().join("map.tif"), maps.path().join("map.tif")).unwrap();
    let out = maps.path().join("out.tif");
    let build = |out: &Path| {
        grim()
            .args(["map", "build", "--gsd", "1"])
            .arg(maps.path())
            .arg("-o")
            .arg(out)
            .assert()
    };
    build(&out)
        .success()
        .stderr(contains("lies in the folder of the maps"));
    let other = maps.path().join("area.grim");
    build(&other)
        .code(2)
        .stderr(contains("out.tif").and(contains("it is a grimnet pack")));
    std::fs::remove_file(&out).unwrap();
    build(&other)
        .success()
        .stderr(contains("lies in the folder").not());
}
