//! Single files: whole or absent, and never somebody else's.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, PermissionsExt as _, symlink};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use grimnet_output::{
    AtomicFile, OutputError, OutputFolder, OutputPolicy, Snapshot, TargetKind, rename_into_place,
    write_atomic, write_bytes_atomic,
};

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_file_appears_when_it_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    let mut file = AtomicFile::create(&path).unwrap();
    file.write_all(b"half").unwrap();
    file.flush().unwrap();
    assert!(!path.exists());
    drop(file);
    assert!(
        names(folder.path()).is_empty(),
        "{:?}",
        names(folder.path())
    );
    write_bytes_atomic(&path, b"whole").unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"whole");
    assert_eq!(names(folder.path()), ["a.txt"]);
}

#[test]
fn a_failed_write_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    fs::write(&path, "old").unwrap();
    let error = write_atomic(&path, |file| {
        file.write_all(b"new")?;
        Err(std::io::Error::other("the source ran dry"))
    })
    .unwrap_err();
    assert!(error.to_string().contains("a.txt: the source ran dry"));
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(names(folder.path()), ["a.txt"]);
}

#[test]
fn access_rights_are_those_of_any_new_file_and_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, ours) = (folder.path().join("plain"), folder.path().join("ours"));
    fs::write(&plain, "").unwrap();
    write_bytes_atomic(&ours, b"").unwrap();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&plain), mode(&ours));
    fs::set_permissions(&ours, fs::Permissions::from_mode(0o640)).unwrap();
    write_bytes_atomic(&ours, b"again").unwrap();
    assert_eq!(mode(&ours) & 0o777, 0o640);
    // Also by a writer with a temporary file of its own.
    fs::write(&plain, "built").unwrap();
    let checked = Snapshot::of(&ours).unwrap();
    rename_into_place(&plain, &ours, &checked).unwrap();
    assert_eq!(fs::read(&ours).unwrap(), b"built");
    assert_eq!(mode(&ours) & 0o777, 0o640);
    // Only root may give files away.
    if std::os::unix::fs::chown(&ours, Some(1234), Some(1235)).is_ok() {
        write_bytes_atomic(&ours, b"of another").unwrap();
        let metadata = fs::metadata(&ours).unwrap();
        assert_eq!((metadata.uid(), metadata.gid()), (1234, 1235));
        assert_eq!(mode(&ours) & 0o777, 0o640);
    }
}

#[test]
fn devices_and_pipes_are_written_through() {
    let before = fs::metadata("/dev/null").unwrap();
    assert_eq!(
        TargetKind::of(Path::new("/dev/null")).unwrap(),
        TargetKind::Stream
    );
    OutputPolicy::new().check_file("/dev/null", &[]).unwrap();
    write_bytes_atomic("/dev/null", b"gone").unwrap();
    let after = fs::metadata("/dev/null").unwrap();
    assert!(after.file_type().is_char_device());
    assert_eq!(before.rdev(), after.rdev());

    let folder = tempfile::tempdir().unwrap();
    let fifo = folder.path().join("fifo");
    let made = Command::new("mkfifo").arg(&fifo).status().unwrap();
    assert!(made.success());
    let reader = std::thread::spawn({
        let fifo = fifo.clone();
        move || fs::read_to_string(fifo).unwrap()
    });
    let policy = OutputPolicy::new();
    policy
        .write(&fifo, |file| file.write_all(b"through"))
        .unwrap();
    assert_eq!(reader.join().unwrap(), "through");
    assert!(fs::metadata(&fifo).unwrap().file_type().is_fifo());
    assert_eq!(names(folder.path()), ["fifo"]);
}

#[test]
fn a_full_device_is_named_once() {
    let error = write_bytes_atomic("/dev/full", b"x").unwrap_err();
    let text = error.to_string();
    assert!(text.starts_with("cannot write /dev/full: "), "{text}");
    assert_eq!(text.matches("/dev/full").count(), 1, "{text}");
    // Also where the error passes through other code.
    let mut file = AtomicFile::create("/dev/full").unwrap();
    file.write_all(b"x").unwrap();
    let error = file.flush().unwrap_err();
    assert!(error.to_string().starts_with("cannot write /dev/full: "));
}

#[test]
fn folders_and_missing_folders_are_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let policy = OutputPolicy::new().overwrite(true);
    let is_folder = policy.check_file(folder.path(), &[]).unwrap_err();
    assert!(matches!(is_folder, OutputError::IsFolder { .. }));
    let slash = format!("{}/new/", folder.path().display());
    assert!(matches!(
        policy.check_file(slash, &[]),
        Err(OutputError::IsFolder { .. })
    ));
    let missing = policy.check_file(folder.path().join("no/a.txt"), &[]);
    assert!(matches!(missing, Err(OutputError::NoFolder { .. })));
    fs::write(folder.path().join("file"), "").unwrap();
    let below_file = policy.check_file(folder.path().join("file/a.txt"), &[]);
    assert!(matches!(below_file, Err(OutputError::NoFolder { .. })));
    policy.check_file(folder.path().join("a.txt"), &[]).unwrap();
    assert_eq!(names(folder.path()), ["file"]);
}

#[test]
fn a_folder_that_cannot_be_written_is_noticed_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o555)).unwrap();
    // Root may write everywhere; then /proc stands in for a folder that cannot be written.
    let path = match fs::write(&path, "") {
        Ok(()) => "/proc/a.txt".into(),
        Err(_) => path,
    };
    let error = OutputPolicy::new().check_file(&path, &[]).unwrap_err();
    assert!(error.to_string().contains(path.to_str().unwrap()));
    assert!(matches!(error, OutputError::Io { .. }), "{error:?}");
}

#[test]
fn an_input_is_never_replaced_under_any_name() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("map.tif");
    fs::write(&input, "map").unwrap();
    fs::create_dir(folder.path().join("sub")).unwrap();
    symlink("map.tif", folder.path().join("link")).unwrap();
    symlink("../map.tif", folder.path().join("sub/link")).unwrap();
    symlink("sub/link", folder.path().join("link_to_link")).unwrap();
    fs::hard_link(&input, folder.path().join("hard")).unwrap();
    for allowed in [false, true] {
        let policy = OutputPolicy::new().overwrite(allowed).protect(&input);
        for name in [
            "map.tif",
            "link",
            "sub/link",
            "link_to_link",
            "hard",
            "sub/../map.tif",
        ] {
            let error = policy
                .check_file(folder.path().join(name), &[b"map"])
                .unwrap_err();
            assert!(
                matches!(error, OutputError::ReplacesInput { .. }),
                "{name}: {error:?}"
            );
        }
    }
    // The input given as a link, the output as the file.
    let policy = OutputPolicy::new()
        .overwrite(true)
        .protect(folder.path().join("link"));
    assert!(policy.write(&input, |_| Ok(())).is_err());
    assert_eq!(fs::read(&input).unwrap(), b"map");
}

#[test]
fn a_protected_folder_protects_all_that_is_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir_all(path("tiles/3/4")).unwrap();
    for name in ["tiles/3/4/5.png", "tiles/notes", "map.tif"] {
        fs::write(path(name), "GRIMPACK").unwrap();
    }
    let policy = OutputPolicy::new().protect_trees([path("tiles/3"), path("map.tif"), path("no")]);
    let error = policy.check_file(path("tiles/3/4/5.png"), &[b"GRIMPACK"]);
    assert!(
        matches!(error, Err(OutputError::InInputFolder { .. })),
        "{error:?}"
    );
    let error = policy.check_file(path("map.tif"), &[b"GRIMPACK"]);
    assert!(matches!(error, Err(OutputError::ReplacesInput { .. })));
    // Beside it, and what is not there yet.
    for name in ["tiles/notes", "tiles/3/4/6.png", "no"] {
        policy.check_file(path(name), &[b"GRIMPACK"]).unwrap();
    }
}

#[test]
fn only_own_files_are_replaced_unless_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    fs::write(&path, "GRIMPACK and more").unwrap();
    let policy = OutputPolicy::new();
    assert!(matches!(
        policy.check_file(&path, &[]),
        Err(OutputError::NotOwn { .. })
    ));
    policy.check_file(&path, &[b"GRIMPACK"]).unwrap();
    assert!(policy.check_file(&path, &[b"GRIMPACK and more?"]).is_err());
    policy
        .overwrite(true)
        .write(&path, |file| file.write_all(b"new"))
        .unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"new");

    // Listed by the folder, thus own also as a single file.
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    output.write_bytes("b", b"ours").unwrap();
    let single = OutputPolicy::new();
    single.check_file(folder.path().join("b"), &[]).unwrap();
    fs::write(folder.path().join("b"), "edited").unwrap();
    assert!(single.check_file(folder.path().join("b"), &[]).is_err());
}

#[test]
fn a_file_that_appears_in_the_meantime_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let file = OutputPolicy::new().create(&path, &[]).unwrap();
    fs::write(&path, "somebody was faster").unwrap();
    assert!(matches!(file.commit(), Err(OutputError::Changed { .. })));
    assert_eq!(fs::read(&path).unwrap(), b"somebody was faster");
    assert_eq!(names(folder.path()), ["a"]);
}

#[test]
fn links_are_followed_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("far")).unwrap();
    let link = folder.path().join("link");
    symlink("far/file", &link).unwrap();
    write_bytes_atomic(&link, b"1").unwrap();
    write_bytes_atomic(&link, b"2").unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::read(folder.path().join("far/file")).unwrap(), b"2");
    let circle = folder.path().join("circle");
    symlink("circle", &circle).unwrap();
    assert!(write_bytes_atomic(&circle, b"").is_err());
}

#[test]
fn long_names_can_be_written() {
    let folder = tempfile::tempdir().unwrap();
    let name = "n".repeat(255);
    write_bytes_atomic(folder.path().join(&name), b"x").unwrap();
    assert_eq!(names(folder.path()), [name]);
}

#[test]
fn a_partial_file_stays_unless_it_is_empty_or_complete() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("answers.jsonl");
    let policy = OutputPolicy::new();
    drop(policy.create_partial(&path).unwrap());
    assert!(names(folder.path()).is_empty());
    let mut file = policy.create_partial(&path).unwrap();
    file.write_all(b"one\n").unwrap();
    drop(file);
    let mut file = policy.create_partial(&path).unwrap();
    assert!(
        file.partial_path()
            .unwrap()
            .ends_with("answers.jsonl.partial-2")
    );
    file.write_all(b"one\ntwo\n").unwrap();
    file.commit().unwrap();
    assert_eq!(
        names(folder.path()),
        ["answers.jsonl", "answers.jsonl.partial"]
    );
    assert_eq!(
        fs::read(folder.path().join("answers.jsonl.partial")).unwrap(),
        b"one\n"
    );
}

#[test]
fn a_partial_file_is_cut_back_to_what_was_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("answers.jsonl");
    let mut file = OutputPolicy::new().create_partial(&path).unwrap();
    file.write_all(b"one\n").unwrap();
    file.flush().unwrap();
    // In part on disk, in part in memory.
    file.write_all(b"tw").unwrap();
    file.flush().unwrap();
    file.write_all(b"o").unwrap();
    file.cut_back(4).unwrap();
    let partial = folder.path().join("answers.jsonl.partial");
    assert_eq!(fs::read(&partial).unwrap(), b"one\n");
    file.write_all(b"three\n").unwrap();
    file.commit().unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"one\nthree\n");
}

/// Bytes of the file that the killed writer writes over and over: each file holds one letter.
const LEN: usize = 300_000;

/// The writer that is killed; not a test by itself.
#[test]
#[ignore = "is started, and killed, by a_kill_at_any_moment_leaves_a_whole_file"]
fn endless_writer() {
    let Some(folder) = std::env::var_os("GRIM_TEST_FOLDER") else {
        return;
    };
    let output = OutputFolder::open(folder, &OutputPolicy::new()).unwrap();
    for letter in (b'a'..=b'z').cycle() {
        output.write_bytes("file", &vec![letter; LEN]).unwrap();
    }
}

#[test]
fn a_kill_at_any_moment_leaves_a_whole_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    let mut whole = 0;
    for round in 0u64..25 {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["endless_writer", "--exact", "--ignored"])
            .env("GRIM_TEST_FOLDER", folder.path())
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_micros(5_000 + round * 2_713 % 30_000));
        child.kill().unwrap();
        child.wait().unwrap();
        // The next run takes the folder as its own, whatever the last one left, and removes the temporary file.
        let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
        output.check(["file"]).unwrap();
        drop(output);
        if let Ok(mut file) = fs::File::open(&file) {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes).unwrap();
            assert_eq!(bytes.len(), LEN);
            assert!(bytes.iter().all(|byte| *byte == bytes[0]));
            whole += 1;
        }
        let left = names(folder.path());
        assert!(
            left.iter()
                .all(|name| name == "file" || name == ".grim-output"),
            "{left:?}"
        );
    }
    assert!(whole > 0, "no round was long enough to write one file");
}

#[test]
fn a_temporary_file_of_a_living_writer_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let mut first = AtomicFile::create(&path).unwrap();
    first.write_all(b"first").unwrap();
    let mut second = AtomicFile::create(&path).unwrap();
    second.write_all(b"second").unwrap();
    assert_ne!(first.partial_path(), second.partial_path());
    first.commit().unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"first");
    second.commit().unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"second");

    // What a dead one left is removed by name only: what a link leads to stays.
    let precious = folder.path().join("precious");
    fs::write(&precious, "kept").unwrap();
    fs::hard_link(&precious, folder.path().join(".a.grim-tmp")).unwrap();
    write_bytes_atomic(&path, b"third").unwrap();
    assert_eq!(fs::read(&precious).unwrap(), b"kept");
    assert_eq!(names(folder.path()), ["a", "precious"]);
}

#[test]
fn an_input_that_becomes_known_while_a_file_is_written_is_spared() {
    let folder = tempfile::tempdir().unwrap();
    let (photo, link) = (folder.path().join("a.jpg"), folder.path().join("link.jpg"));
    fs::write(&photo, "a photo").unwrap();
    fs::hard_link(&photo, &link).unwrap();
    let policy = OutputPolicy::new().overwrite(true);
    let mut partial = policy.create_partial(&photo).unwrap();
    let mut whole = policy.create(&photo, &[]).unwrap();
    partial.write_all(b"a track").unwrap();
    whole.write_all(b"a page").unwrap();
    policy.clone().add_inputs([&link]);
    for file in [partial, whole] {
        assert!(matches!(
            file.commit(),
            Err(OutputError::ReplacesInput { .. })
        ));
    }
    assert_eq!(fs::read(&photo).unwrap(), b"a photo");
    let kept = folder.path().join("a.jpg.partial");
    assert_eq!(fs::read(kept).unwrap(), b"a track");
}

#[test]
#[cfg(target_os = "linux")]
fn a_file_that_is_mounted_by_itself_is_refused_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let (there, mounted) = (folder.path().join("there"), folder.path().join("mounted"));
    fs::write(&there, "there").unwrap();
    fs::write(&mounted, "").unwrap();
    let bound = Command::new("mount")
        .arg("--bind")
        .args([&there, &mounted])
        .stderr(std::process::Stdio::null())
        .status();
    if !bound.is_ok_and(|status| status.success()) {
        // Only root may mount.
        return;
    }
    let policy = OutputPolicy::new().overwrite(true);
    let checked = policy.check_file(&mounted, &[]);
    let unbound = Command::new("umount").arg(&mounted).status();
    assert!(unbound.unwrap().success());
    assert!(
        checked
            .unwrap_err()
            .to_string()
            .contains("mount its folder")
    );
    policy.check_file(&mounted, &[]).unwrap();
    assert_eq!(names(folder.path()), ["mounted", "there"]);
}
