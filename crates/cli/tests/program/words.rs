//! Exit status, messages, and what is refused before any work.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use predicates::prelude::*;
use predicates::str::contains;

use super::{demo, grim, lines, locate, pack, photo};

#[test]
fn a_missing_photo_is_unreadable_input_among_others_too() {
    let gone = || PathBuf::from("/no/such.jpg");
    for arguments in [&[][..], &["--adapt", "flight"]] {
        let (text, status) = locate(arguments, &[gone()]);
        assert_eq!((lines(&text).len(), status), (1, 2), "{arguments:?}");
    }
    let (text, status) = locate(&[], &[gone(), photo(1)]);
    assert_eq!(status, 2);
    let answers = lines(&text);
    assert_eq!(answers[1]["state"], "fix", "the others are answered");
    let reason = answers[0]["reason"].as_str().unwrap();
    assert_eq!(reason.matches("/no/such.jpg").count(), 1, "{reason}");
    assert_eq!(reason.matches("No such file").count(), 1, "{reason}");
    // A photo without a fix is no error.
    assert_eq!(locate(&["--near", "52.5,13.4,100"], &[photo(1)]).1, 1);
}

#[test]
#[cfg(unix)]
fn a_reader_that_goes_away_is_no_error() {
    let grim = assert_cmd::cargo::cargo_bin("grim");
    let run = |arguments: &str| {
        let line = format!("{} {arguments} | head -c 1", grim.display());
        // Warnings about the model or the photos are not meant here.
        let output = Command::new("bash")
            .args(["-c", &line])
            .env("GRIM_LOG", "error")
            .output()
            .unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.stdout.len(), errors.as_str()), (1, ""), "{line}");
    };
    let (pack, photos) = (pack(), demo().join("photos"));
    for format in ["jsonl", "csv", "kml", "table", "geojson"] {
        run(&format!(
            "locate --pack {} {} --format {format}",
            pack.display(),
            photos.display()
        ));
    }
    run(&format!("map info {} --json", pack.display()));
    run("completions bash");
    run("--help");
    run("");
}

#[test]
#[cfg(unix)]
fn a_full_disk_is_said_once_with_the_file() {
    let output = grim()
        .args(["locate", "--out", "/dev/full", "--pack"])
        .arg(pack())
        .arg(photo(1))
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(errors.matches("/dev/full").count(), 1, "{errors}");
    assert_eq!(errors.matches("No space left").count(), 1, "{errors}");
}

#[test]
fn numbers_out_of_range_are_refused_with_their_option() {
    let cases: &[(&[&str], &str)] = &[
        (
            &[
                "map",
                "build",
                "m",
                "-o",
                "o",
                "--height-agl",
                "100",
                "--hfov",
                "400",
            ],
            "--hfov",
        ),
        (&["map", "build", "m", "-o", "o", "--hfov", "70"], "--hfov"),
        (
            &[
                "map",
                "build",
                "m",
                "-o",
                "o",
                "--height-agl",
                "-5",
                "--hfov",
                "70",
            ],
            "--height-agl",
        ),
        (
            &["map", "build", "m", "-o", "o", "--gsd", "0.2,-1"],
            "--gsd",
        ),
        (&["map", "build", "m", "-o", "o", "--gsd", "nan"], "--gsd"),
        (
            &["locate", "-p", "p", "a", "--height-agl=-1"],
            "--height-agl",
        ),
        (
            &["locate", "-p", "p", "a", "--map-error", "nan"],
            "--map-error",
        ),
        (
            &["locate", "-p", "p", "a", "--min-confidence", "1.5"],
            "--min-confidence",
        ),
        (
            &["locate", "-p", "p", "a", "--budget-ms", "0"],
            "--budget-ms",
        ),
        (&["locate", "-p", "p", "a", "--top-k", "0"], "--top-k"),
        (
            &["locate", "-p", "p", "a", "--threads", "5000"],
            "--threads",
        ),
        (
            &["eval", "f", "-o", "o", "--map-error", "nan"],
            "--map-error",
        ),
        (
            &["eval", "f", "-o", "o", "--footprint-width=-5"],
            "--footprint-width",
        ),
        (
            &["eval", "f", "-o", "o", "--truth-error", "-1"],
            "--truth-error",
        ),
        (&["demo", "--photos", "0"], "--photos"),
        (&["demo", "--photos", "1000000000"], "from 1 to 100000"),
        (
            &["calibrate", "-o", "o", "--photos", "0"],
            "from 1 to 100000",
        ),
        (
            &["calibrate", "-o", "o", "--worlds", "1001"],
            "from 0 to 1000",
        ),
        (
            &["locate", "-p", "p", "a", "--height-agl", "1"],
            "from 2 to 20000",
        ),
        (
            &["locate", "-p", "p", "a", "--hfov", "170"],
            "from 1 to 150",
        ),
        (
            &["locate", "-p", "p", "a", "--heading", "1e308"],
            "from north (-720 to 720)",
        ),
        (
            &["locate", "-p", "p", "a", "--map-error", "1e308"],
            "from 0 to 100000",
        ),
        (
            &["locate", "-p", "p", "a", "--gsd", "1e-308"],
            "from 0.00001 to 1000",
        ),
        (
            &["serve", "-p", "p", "--listen", "localhost:8080"],
            "such as 127.0.0.1:8080",
        ),
        (&["demo", "--serve", "foo"], "such as 127.0.0.1:8080"),
    ];
    for (arguments, option) in cases {
        grim()
            .args(*arguments)
            .assert()
            .code(2)
            .stderr(contains(*option));
    }
}

#[test]
fn options_without_effect_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("eval f --out OUT --adapt flight --track", "--adapt flight"),
        (
            "eval f --out OUT --elsewhere g --footprint-width 100",
            "--footprint-width",
        ),
        ("eval f --out OUT --elsewhere g --heading exif", "--heading"),
        (
            "eval f --out OUT --track --recall-radius 9",
            "--recall-radius",
        ),
        (
            "eval --world 7 --out OUT --track --footprint-width 9",
            "--footprint-width",
        ),
        (
            "eval --world 7 --out OUT --track --map MAP",
            "leave out --map",
        ),
        (
            "eval --world 7 --out OUT --track --crs EPSG:32632",
            "leave out --crs",
        ),
        ("eval --world 7 --out OUT --zoom 7", "leave out --crs"),
        ("eval f --out OUT --track --minutes 7", "--minutes <M>"),
        ("eval f --out OUT --track --worlds 2", "--worlds <N>"),
        (
            "eval f --out OUT --track --frame-rate 1",
            "--frame-rate <HZ>",
        ),
        (
            "eval f --out OUT --track --simulated-flights 0",
            "--simulated-flights <N>",
        ),
        ("eval f --out OUT --elsewhere g --track", "--track"),
        (
            "eval --world 7 --out OUT --elsewhere g --map MAP",
            "--world",
        ),
        ("eval f --out OUT --elsewhere g --commit a", "--commit"),
        ("eval f --out OUT --elsewhere-seed 2", "--elsewhere"),
        ("calibrate -o OUT --places even", "--datasets <FOLDER>"),
        ("calibrate -o OUT --pictures-gsd 0.2", "--pictures <DIR>"),
        (
            "calibrate -o OUT --elsewhere-trials 3",
            "--elsewhere <FOLDER>",
        ),
        ("calibrate -o OUT --observed a --worlds 3", "--worlds <N>"),
        ("map build MAP -o OUT --resolution 640", "--mode paper"),
        ("locate -p PACK PHOTO --out OUT --zoom 7", "--map"),
        (
            "locate -p PACK PHOTO --out OUT --mode paper",
            "was built in default mode",
        ),
        (
            "locate -p PACK PHOTO --out OUT --mode paper --min-confidence 0.9",
            "--min-confidence",
        ),
        (
            "track --replay OUT --mavlink tcp:127.0.0.1:1",
            "--mavlink <ADDRESS>",
        ),
        ("track --replay OUT --nmea a", "--nmea <TARGET>"),
        ("track --replay OUT --telemetry a", "--telemetry <FILE>"),
        ("track --replay OUT --start 24,120,9", "--start <LAT"),
        ("track --replay OUT --map-error 2", "--map-error <M>"),
        ("track --replay OUT --follow", "--follow"),
        ("track --replay OUT --hfov 70 -o OUT", "--hfov <DEG>"),
        (
            "track -p PACK PHOTO --mavlink-message odometry",
            "--mavlink <ADDRESS>",
        ),
        (
            "track -p PACK PHOTO --mavlink-system 1",
            "--mavlink <ADDRESS>",
        ),
        (
            "track -p PACK PHOTO --mavlink-key gone",
            "--mavlink <ADDRESS>",
        ),
        (
            "track -p PACK PHOTO --telemetry-delay 1",
            "expected --telemetry FILE",
        ),
        (
            "track -p PACK PHOTO --camera-mount 90",
            "or --telemetry FILE",
        ),
        (
            "track -p PACK PHOTO --camera-mount 90 --mavlink udpin:127.0.0.1:0 --mavlink-camera unknown",
            "--mavlink-camera fixed or gimbal",
        ),
        (
            "track -p PACK PHOTO --camera-mount nose",
            "clockwise from the nose",
        ),
        (
            "track -p PACK PHOTO --frame-latency 1",
            "these are recorded",
        ),
        (
            "track -p PACK - --frame-latency 1",
            "expected --mavlink, or --nmea",
        ),
        (
            "track -p PACK rtsp://a/b --clock-offset 1",
            "--frame-latency says how old",
        ),
        (
            "track -p PACK rtsp://a/b --time-from name",
            "where the times of photos come from",
        ),
        (
            "track -p PACK PHOTO --fps 2 --time-from name",
            "cannot be used with",
        ),
    ];
    let out = folder.path().join("out");
    for (arguments, said) in cases {
        let mut command = grim();
        for argument in arguments.split(' ') {
            match argument {
                "OUT" => command.arg(&out),
                "MAP" => command.arg(demo().join("map.tif")),
                "PACK" => command.arg(pack()),
                "PHOTO" => command.arg(photo(1)),
                other => command.arg(other),
            };
        }
        command.assert().code(2).stderr(contains(said));
        assert!(!out.exists(), "{arguments:?}");
    }
}

/// Not after the worlds were drawn; and without an option of other commands.
#[test]
fn a_calibration_on_photos_without_places_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    for data in [demo().to_owned(), demo().join("photos")] {
        grim()
            .current_dir(folder.path())
            .args(["calibrate", "-o", "m", "--worlds", "1000", "--datasets"])
            .arg(data)
            .timeout(Duration::from_secs(60))
            .assert()
            .code(2)
            .stderr(contains("needs a column `place`").and(contains("--map").not()));
    }
}

#[test]
fn another_map_than_the_packs_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    // The same map in content, another in bytes.
    let map = folder.path().join("other.tif");
    let mut bytes = fs::read(demo().join("map.tif")).unwrap();
    bytes.push(0);
    fs::write(&map, bytes).unwrap();
    let drawings = folder.path().join("drawings");
    grim()
        .args(["locate", "--pack"])
        .arg(pack())
        .arg(photo(1))
        .arg("--draw")
        .arg(&drawings)
        .arg("--map")
        .arg(&map)
        .assert()
        .code(2)
        .stderr(contains("is not the map that").and(contains("other.tif")));
    assert!(!drawings.exists());
}

/// Not a photo without a time: its name is wrong.
#[test]
fn a_photo_of_a_flight_that_is_not_there_is_named() {
    grim()
        .args(["track", "--pack"])
        .arg(pack())
        .arg(photo(1))
        .arg("gone.jpg")
        .assert()
        .code(2)
        .stderr(contains("cannot read gone.jpg"));
}

#[test]
#[cfg(unix)]
fn pipes_are_refused_and_never_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo.jpg");
    assert!(
        Command::new("mkfifo")
            .arg(&fifo)
            .status()
            .unwrap()
            .success()
    );
    let fifo = fifo.to_str().unwrap();
    let pack = pack();
    let (pack, photo) = (pack.to_str().unwrap(), photo(1));
    let photo = photo.to_str().unwrap();
    let refused = |arguments: &[&str]| {
        grim()
            .args(arguments)
            .timeout(Duration::from_secs(60))
            .assert()
            .code(2)
            .stdout(contains("is a pipe").or(predicate::str::is_empty()))
            .stderr(contains("pipe").or(contains("could not be read")));
    };
    let out = folder.path().join("x.grim");
    let out = out.to_str().unwrap();
    refused(&["locate", "--pack", pack, fifo]);
    refused(&["locate", "--pack", fifo, photo]);
    refused(&["map", "build", fifo, "-o", out]);
    refused(&["map", "info", fifo]);
    refused(&["map", "verify", fifo]);
    refused(&["model", "info", fifo]);
    refused(&["calibrate", "--observed", fifo, "-o", out]);
    refused(&["track", "--pack", pack, fifo]);
    for option in ["--truth", "--telemetry"] {
        refused(&["track", "--pack", pack, photo, "--fps", "1", option, fifo]);
    }
    refused(&[
        "link",
        "check",
        "--mavlink",
        "udpin:127.0.0.1:0",
        "--mavlink-key",
        fifo,
    ]);
    // A pipe among photos is no photo; here there is no other.
    let photos = folder.path().to_str().unwrap();
    let map = demo().join("map.tif");
    let map = map.to_str().unwrap();
    grim()
        .args(["eval", photos, "--map", map, "--out", out])
        .timeout(Duration::from_secs(60))
        .assert()
        .code(2)
        .stderr(predicate::str::is_empty().not());
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_is_named() {
    let (pack, photo) = (pack(), photo(1));
    let (pack, photo) = (pack.to_str().unwrap(), photo.to_str().unwrap());
    for arguments in [
        &[][..],
        &["model", "info"],
        &["completions", "bash"],
        &["locate", "--pack", pack, photo],
    ] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_grim"))
            .args(arguments)
            .stdout(full)
            .output()
            .unwrap();
        let errors = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
        assert!(
            errors.contains("cannot write to standard output"),
            "{arguments:?}: {errors}"
        );
    }
}

#[test]
#[cfg(unix)]
fn nothing_from_a_file_name_steers_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("a\x1b[2J\x07.jpg");
    fs::copy(photo(1), &name).unwrap();
    let missing = folder.path().join("b\x1b]0;title\x07.grim");
    for format in ["table", "jsonl", "csv", "kml"] {
        let (text, _) = locate(&["--format", format], std::slice::from_ref(&name));
        assert!(!text.contains('\x1b') && !text.contains('\x07'), "{text:?}");
    }
    let output = grim()
        .args(["locate", "--pack"])
        .arg(&missing)
        .arg(&name)
        .env("GRIM_LOG", "debug")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(!output.stderr.contains(&0x1b));
    // A warning names the map beside its message.
    let map = folder.path().join("m\x1b[31m.tif");
    fs::copy(demo().join("map.tif"), &map).unwrap();
    let output = grim()
        .args(["map", "check", "--crs", "EPSG:25833"])
        .arg(&map)
        .output()
        .unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("\\u{1b}[31m.tif"), "{errors:?}");
    assert!(!errors.contains('\x1b'), "{errors:?}");
}

#[test]
fn messages_have_no_colours_in_a_pipe() {
    let output = grim()
        .args(["locate", "--pack"])
        .arg(pack())
        .arg("/no/such.jpg")
        .env_remove("NO_COLOR")
        .output()
        .unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.contains("could not be read"), "{errors}");
    assert!(!errors.contains('\x1b'), "{errors:?}");
}

#[test]
fn a_damaged_pack_is_found_by_verify() {
    let folder = tempfile::tempdir().unwrap();
    let path: &Path = &folder.path().join("x.grim");
    let mut bytes = fs::read(pack()).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
    grim()
        .args(["map", "verify"])
        .arg(path)
        .assert()
        .code(2)
        .stderr(contains("x.grim").and(contains("damaged")));
}

#[test]
fn without_a_command_three_are_shown() {
    grim().assert().success().stdout(
        contains("grim demo")
            .and(contains("grim map build"))
            .and(contains("grim locate")),
    );
}
