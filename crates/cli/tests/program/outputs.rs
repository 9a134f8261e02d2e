//! Outputs never replace an input, nor a file that the program did not write.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use predicates::prelude::*;
use predicates::str::contains;

use super::interruptions::start;
use super::{demo, grim, locate, pack, photo};

/// Every file below a folder with its content, but for the list of outputs.
pub(super) fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else if path.file_name().unwrap() != ".grim-output" {
            found.insert(path.clone(), fs::read(path).unwrap());
        }
    }
    found
}

/// A map of noise whose pack has a few tiles, and the options that place it.
fn small_map(folder: &Path) -> (PathBuf, [&'static str; 2]) {
    let mut state = 1u32;
    let noise = image::RgbImage::from_fn(1100, 1100, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let bytes = state.to_be_bytes();
        image::Rgb([bytes[0], bytes[1], bytes[0] ^ bytes[1]])
    });
    let path = folder.join("map.png");
    noise.save(&path).unwrap();
    (path, ["--corners", "13.400,52.500,13.404,52.5025"])
}

fn build(map: &Path, place: &[&str], out: &Path) -> assert_cmd::Command {
    let mut command = grim();
    command.args(["map", "build", "--gsd", "0.25"]);
    command.args(place).arg(map).arg("-o").arg(out);
    command
}

/// Starts a demo and kills it when it has written a file.
fn demo_killed_after(folder: &Path, file: &str) {
    let arguments = ["demo", "--photos", "2", "--out", folder.to_str().unwrap()];
    let mut child = start(&arguments);
    while !folder.join(file).exists() {
        assert!(child.try_wait().unwrap().is_none(), "ended without {file}");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn the_demo_spares_what_a_user_keeps_in_its_folder_and_survives_kills() {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    fs::create_dir(&photos).unwrap();
    fs::write(photos.join("mine.jpg"), "my photo").unwrap();
    fs::write(folder.path().join("truth.csv"), "my truth").unwrap();
    let before = contents(folder.path());
    let demo = || {
        let mut command = grim();
        command.args(["demo", "--photos", "1", "--out"]);
        command.arg(folder.path());
        command
    };
    demo()
        .assert()
        .code(2)
        .stderr(contains("truth.csv").and(contains("--overwrite")));
    assert_eq!(contents(folder.path()), before);

    // Without a file in its way it runs, whatever a killed run left, and removes only its own.
    fs::remove_file(folder.path().join("truth.csv")).unwrap();
    demo_killed_after(folder.path(), "photos/flight_002.jpg");
    image::open(photos.join("flight_001.jpg")).unwrap();
    image::open(folder.path().join("map.tif")).unwrap();
    demo_killed_after(folder.path(), "fixes.jsonl");
    let fixes = fs::read_to_string(folder.path().join("fixes.jsonl")).unwrap();
    assert_eq!(super::lines(&fixes).len(), 2);
    demo().assert().success();
    assert!(!photos.join("flight_002.jpg").exists());
    assert_eq!(fs::read(photos.join("mine.jpg")).unwrap(), b"my photo");
}

#[test]
fn answers_that_are_there_are_not_said_to_be_of_another_program() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("answers.csv");
    let run = |more: &[&str]| {
        let mut command = grim();
        command.args(["locate", "--pack"]).arg(pack()).arg(photo(1));
        command.arg("-o").arg(&out).args(more).assert()
    };
    run(&[]).success();
    let before = fs::read(&out).unwrap();
    let refused = "answers.csv already exists and is not known to be an unchanged file of this program; choose another output path, or \
                   allow overwriting (--overwrite allows it)";
    run(&[]).code(2).stderr(contains(refused));
    assert_eq!(fs::read(&out).unwrap(), before);
    run(&["--overwrite"]).success();
}

#[test]
fn a_pack_replaces_packs_only() {
    let folder = tempfile::tempdir().unwrap();
    let (map, place) = small_map(folder.path());
    let before = fs::read(&map).unwrap();
    for overwrite in [&[][..], &["--overwrite"]] {
        build(&map, &place, &map)
            .args(overwrite)
            .assert()
            .code(2)
            .stderr(contains("never replaces an input"));
    }
    assert_eq!(fs::read(&map).unwrap(), before);

    let out = folder.path().join("x.grim");
    fs::write(&out, "a letter").unwrap();
    build(&map, &place, &out)
        .assert()
        .code(2)
        .stderr(contains("--overwrite"));
    assert_eq!(fs::read(&out).unwrap(), b"a letter");
    build(&map, &place, &out)
        .arg("--overwrite")
        .assert()
        .success();
    // Another map's pack is replaced without a word, as it was always.
    let other = ["--corners", "13.500,52.500,13.504,52.5025"];
    build(&map, &other, &out).assert().success();
}

#[test]
fn a_pack_never_replaces_what_the_map_is_read_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (scan, _) = small_map(folder.path());
    fs::create_dir_all(path("maps")).unwrap();
    fs::copy(demo().join("map.tif"), path("maps/map.tif")).unwrap();
    fs::write(path("list.txt"), "maps/map.tif").unwrap();
    fs::write(path("map.pgw"), "0.25\n0\n0\n-0.25\n390000\n5820000\n").unwrap();
    fs::create_dir_all(path("tiles/18/140833")).unwrap();
    image::open(&scan)
        .unwrap()
        .crop_imm(0, 0, 256, 256)
        .save(path("tiles/18/140833/85977.png"))
        .unwrap();
    let before = contents(folder.path());
    let utm = ["--crs", "EPSG:32633"];
    let cases: [(&str, &[&str], &str); 4] = [
        ("maps", &[], "maps/map.tif"),
        ("list.txt", &[], "maps/map.tif"),
        ("map.png", &utm, "map.pgw"),
        ("tiles", &[], "tiles/18/140833/85977.png"),
    ];
    for (map, place, out) in cases {
        for command in [
            &["build", "--gsd", "4.8", "-o"][..],
            &["check", "--draw"][..],
        ] {
            grim()
                .arg("map")
                .args(command)
                .arg(path(out))
                .arg(path(map))
                .args(place)
                .arg("--overwrite")
                .assert()
                .code(2)
                .stderr(contains("never replaces an input"));
            assert!(contents(folder.path()) == before, "{command:?} {map}");
        }
    }
    // As it was left by a demo.
    grim()
        .args(["map", "build", "--gsd", "4.8", "-o"])
        .arg(demo().join("map.tif"))
        .arg(demo())
        .assert()
        .code(2)
        .stderr(contains("never replaces an input"));
}

#[test]
fn what_others_keep_under_the_names_of_working_files_stays() {
    let folder = tempfile::tempdir().unwrap();
    let (map, place) = small_map(folder.path());
    let out = folder.path().join("x.grim");
    for ending in ["partial", "assembling"] {
        let notes = folder.path().join(format!("x.grim.{ending}"));
        fs::write(&notes, "my notes").unwrap();
        let before = contents(folder.path());
        build(&map, &place, &out)
            .arg("--overwrite")
            .assert()
            .code(2)
            .stderr(contains("in the way"));
        assert!(contents(folder.path()) == before);
        fs::remove_file(&notes).unwrap();
        #[cfg(unix)]
        {
            let kept = folder.path().join("notes");
            fs::write(&kept, "my notes").unwrap();
            std::os::unix::fs::symlink(&kept, &notes).unwrap();
            build(&map, &place, &out)
                .assert()
                .code(2)
                .stderr(contains("in the way"));
            assert!(notes.is_symlink());
            assert_eq!(fs::read(&kept).unwrap(), b"my notes");
            fs::remove_file(&notes).unwrap();
        }
    }
    build(&map, &place, &out).assert().success();
}

#[test]
fn an_existing_folder_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let (map, place) = small_map(folder.path());
    let out = folder.path().join("folder");
    fs::create_dir(&out).unwrap();
    build(&map, &place, &out)
        .assert()
        .code(2)
        .stderr(contains("is a folder"));
    build(&map, &place, &folder.path().join("no/x.grim"))
        .assert()
        .code(2)
        .stderr(contains("does not exist"));
    assert!(!folder.path().join("folder.partial").exists());
    let (_, status) = locate(&["--out", out.to_str().unwrap()], &[photo(1)]);
    assert_eq!(status, 2);
}

#[test]
#[cfg(unix)]
fn a_device_is_written_through() {
    use std::os::unix::fs::FileTypeExt as _;
    let folder = tempfile::tempdir().unwrap();
    let (map, place) = small_map(folder.path());
    let null = Path::new("/dev/null");
    build(&map, &place, null).assert().success();
    assert!(fs::metadata(null).unwrap().file_type().is_char_device());
    assert!(!Path::new("/dev/null.partial").exists());
    // Standard output gets the same pack as a file.
    let file = folder.path().join("x.grim");
    build(&map, &place, &file).assert().success();
    let piped = build(&map, &place, Path::new("/dev/stdout"))
        .output()
        .unwrap();
    assert!(piped.stdout == fs::read(file).unwrap());
    // It is built in the temporary folder.
    let refused = build(&map, &place, Path::new("/dev/stdout"))
        .env("TMPDIR", folder.path().join("missing"))
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("TMPDIR"));
}

#[test]
fn drawings_spare_the_photos() {
    let folder = tempfile::tempdir().unwrap();
    for number in [1, 2] {
        let name = format!("{number}.jpg");
        fs::copy(photo(number), folder.path().join(name)).unwrap();
    }
    let before = contents(folder.path());
    let path = folder.path().to_str().unwrap();
    for overwrite in [&[][..], &["--overwrite"]] {
        let arguments = [&["--draw", path], overwrite].concat();
        let (text, status) = locate(&arguments, &[folder.path().to_owned()]);
        assert_eq!((status, text.as_str()), (2, ""));
    }
    assert_eq!(contents(folder.path()), before);
}

#[test]
fn drawings_do_not_become_photos_of_the_next_run() {
    let folder = tempfile::tempdir().unwrap();
    // Its drawing would have another name: 1.jpg.
    fs::copy(photo(1), folder.path().join("1.JPG")).unwrap();
    let before = contents(folder.path());
    grim()
        .current_dir(folder.path())
        .args(["locate", "1.JPG", "--draw"])
        .arg(folder.path())
        .arg("--pack")
        .arg(fs::canonicalize(pack()).unwrap())
        .assert()
        .code(2)
        .stdout("")
        .stderr(contains(
            "drawings have the names of their photos; choose another folder than that of the photos",
        ));
    assert_eq!(contents(folder.path()), before);
}

#[test]
fn a_photo_that_is_not_drawn_keeps_no_drawing_of_an_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("1.jpg");
    fs::copy(photo(1), &copy).unwrap();
    let drawings = folder.path().join("drawings");
    let photos = [copy.clone(), photo(2)];
    let drawn = |arguments: &[&str]| {
        let to = ["--draw", drawings.to_str().unwrap()];
        let status = locate(&[&to[..], arguments].concat(), &photos).1;
        let names = ["1.jpg", "flight_002.jpg"].map(|name| drawings.join(name).exists());
        (status, names)
    };
    assert_eq!(drawn(&[]), (0, [true, true]));
    assert_eq!(drawn(&["--near", "40,40,100"]), (1, [false, false]));
    assert_eq!(drawn(&[]), (0, [true, true]));
    fs::write(&copy, "no picture").unwrap();
    assert_eq!(drawn(&[]), (2, [false, true]));
}

#[test]
#[cfg(unix)]
fn a_failed_drawing_costs_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.path().join("flight_001.jpg")).unwrap();
    let (text, status) = locate(
        &["--draw", folder.path().to_str().unwrap()],
        &[photo(1), photo(2)],
    );
    assert_eq!(super::lines(&text).len(), 2);
    assert_eq!(status, 2, "not all was written that was asked for");
    let drawn = folder.path().join("flight_002.jpg");
    assert!(image::open(drawn).unwrap().width() > 100);
}

#[test]
fn an_evaluation_spares_the_photos_wherever_the_truth_file_names_them() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("out"));
    fs::create_dir_all(data.join("photos/sub")).unwrap();
    let absolute = folder.path().join("elsewhere.jpg");
    fs::copy(photo(1), &absolute).unwrap();
    fs::copy(photo(2), data.join("photos/sub/a.jpg")).unwrap();
    let truth = fs::read_to_string(demo().join("truth.csv")).unwrap();
    let rows: Vec<&str> = truth.lines().collect();
    let renamed = |row: &str, name: &str| format!("{name},{}", row.split_once(',').unwrap().1);
    let table = [
        rows[0].to_owned(),
        renamed(rows[1], absolute.to_str().unwrap()),
        renamed(rows[2], "sub/a.jpg"),
    ];
    fs::write(data.join("truth.csv"), table.join("\n")).unwrap();
    let before = [contents(&data), contents(&demo().join("photos"))];
    let photo_before = fs::read(&absolute).unwrap();
    let eval = || {
        let mut command = grim();
        command.arg("eval").arg(&data);
        command.arg("--map").arg(demo().join("map.tif"));
        command.args(["--heading", "exif", "--out"]).arg(&out);
        command
    };
    eval().assert().success();
    assert_eq!(fs::read(&absolute).unwrap(), photo_before);
    assert_eq!([contents(&data), contents(&demo().join("photos"))], before);
    let summary = super::json(&out.join("summary.json"));
    assert_eq!(summary["heading_from_the_photo"]["frames"], 2);
    assert!(out.join("matches/sub_a.jpg").exists());

    // A second run replaces its own results, and not what was edited in the meantime.
    eval().assert().success();
    fs::write(out.join("report.html"), "my notes").unwrap();
    eval().assert().code(2).stderr(contains("report.html"));
    assert_eq!(fs::read(out.join("report.html")).unwrap(), b"my notes");
}

#[test]
#[cfg(unix)]
fn answers_are_readable_by_whom_the_umask_lets() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let (plain, answers) = (folder.path().join("plain"), folder.path().join("a.jsonl"));
    fs::write(&plain, "").unwrap();
    let (_, status) = locate(&["--out", answers.to_str().unwrap()], &[photo(1)]);
    assert_eq!(status, 0);
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&answers), mode(&plain));
    // The answers of a run are not replaced by those of another without being asked.
    let again = ["--out", answers.to_str().unwrap()];
    assert_eq!(locate(&again, &[photo(2)]).1, 2);
    let allowed = [&again[..], &["--overwrite"]].concat();
    assert_eq!(locate(&allowed, &[photo(2)]).1, 0);
    let text = fs::read_to_string(&answers).unwrap();
    assert!(text.contains("flight_002"));
    assert!(!folder.path().join("a.jsonl.partial").exists());
}

#[test]
fn an_unreadable_map_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("cut.tif");
    let whole = fs::read(demo().join("map.tif")).unwrap();
    // The tail holds the directory: damage the pixels, keep the structure.
    let mut damaged = whole.clone();
    let len = damaged.len();
    damaged[64..len / 2].fill(0xff);
    fs::write(&map, damaged).unwrap();
    let out = folder.path().join("x.grim");
    build(&map, &[], &out)
        .assert()
        .code(2)
        .stderr(contains("cut.tif"));
    let left: Vec<_> = contents(folder.path()).into_keys().collect();
    assert_eq!(left, [map]);
}

#[test]
fn manual_pages_and_completions() {
    let folder = tempfile::tempdir().unwrap();
    let man = folder.path().join("man1");
    for _ in 0..2 {
        grim().arg("man").arg(&man).assert().success();
    }
    for name in ["grim.1", "grim-locate.1", "grim-map-build.1"] {
        let page = fs::read_to_string(man.join(name)).unwrap();
        assert!(page.contains(".SH NAME"), "{name}");
        assert!(page.contains(name.trim_end_matches(".1")) || page.contains("grim\\-"));
    }
    for shell in ["bash", "zsh", "fish"] {
        grim()
            .args(["completions", shell])
            .assert()
            .success()
            .stdout(contains("locate").and(contains("overwrite")));
    }
    // Packs can be read while they are built into.
    assert!(pack().exists());
}

#[test]
#[cfg(unix)]
fn a_calibration_and_its_observations_spare_files_of_others() {
    use std::os::unix::fs::FileTypeExt as _;
    let folder = tempfile::tempdir().unwrap();
    let observed = folder.path().join("observed.csv");
    crate::faults::observations::write(&observed, 300);
    let before = fs::read(&observed).unwrap();
    let calibrate = |out: &Path, more: &[&str]| {
        let mut command = grim();
        command.args(["calibrate", "-o"]).arg(out).args(more);
        command.assert()
    };
    let observed = observed.to_str().unwrap();
    let letter = folder.path().join("letter.txt");
    fs::write(&letter, "a letter").unwrap();
    calibrate(&letter, &["--observed", observed])
        .code(2)
        .stderr(contains("--overwrite"));
    calibrate(
        Path::new(observed),
        &["--observed", observed, "--overwrite"],
    )
    .code(2)
    .stderr(contains("never replaces an input"));
    let model = folder.path().join("new.safetensors");
    let letter = letter.to_str().unwrap();
    calibrate(&model, &["--observations", letter])
        .code(2)
        .stderr(contains("--overwrite"));
    assert_eq!(fs::read(letter).unwrap(), b"a letter");
    assert_eq!(fs::read(observed).unwrap(), before);
    // A device is written through, and stays one.
    calibrate(Path::new("/dev/null"), &["--observed", observed]).success();
    let null = fs::metadata("/dev/null").unwrap();
    assert!(null.file_type().is_char_device());
    calibrate(&model, &["--observed", observed]).success();
    calibrate(&model, &["--observed", observed])
        .code(2)
        .stderr(contains("--overwrite"));
}

#[test]
#[cfg(feature = "train")]
fn a_training_run_spares_files_of_others() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("training.toml");
    crate::faults::training::write_config(&config, 1, 1);
    let train = |arguments: &[&str]| {
        let mut command = grim();
        command.current_dir(folder.path());
        command.args(["train", "training.toml"]).args(arguments);
        command.assert()
    };
    let run = folder.path().join("run");
    fs::create_dir(&run).unwrap();
    for name in ["model.safetensors", "checkpoint.safetensors", "curves.csv"] {
        fs::write(run.join(name), "mine").unwrap();
        train(&[])
            .code(2)
            .stderr(contains(name).and(contains("--overwrite")));
        assert_eq!(fs::read(run.join(name)).unwrap(), b"mine");
        fs::remove_file(run.join(name)).unwrap();
    }
    train(&[]).success();
    // A run is not replaced by another, and its model is not that of another configuration.
    let checkpoint = fs::read(run.join("checkpoint.safetensors")).unwrap();
    train(&[])
        .code(2)
        .stderr(contains("--resume").and(contains("--overwrite")));
    assert_eq!(
        fs::read(run.join("checkpoint.safetensors")).unwrap(),
        checkpoint
    );
    crate::faults::training::write_config(&config, 2, 1);
    train(&["--export"]).code(2).stderr(contains("seed"));
    crate::faults::training::write_config(&config, 1, 1);
    // Its own files are replaced, and what was edited in the meantime is not.
    train(&["--resume"]).success();
    fs::write(run.join("curves.csv"), "my notes").unwrap();
    train(&[]).code(2).stderr(contains("curves.csv"));
    assert_eq!(fs::read(run.join("curves.csv")).unwrap(), b"my notes");
    train(&["--overwrite"]).success();
}
