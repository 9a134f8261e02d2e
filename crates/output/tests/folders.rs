//! Folders of results.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs;
use std::io::{Seek as _, SeekFrom, Write as _};

use grimnet_output::{LISTING_NAME, OutputError, OutputFolder, OutputPolicy};

#[test]
fn a_second_run_replaces_its_own_files_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a/b");
    let policy = OutputPolicy::new();
    let first = OutputFolder::open(&path, &policy).unwrap();
    first.write_bytes("summary.json", b"1").unwrap();
    first.write_bytes("edited.json", b"1").unwrap();
    drop(first);
    fs::write(path.join("edited.json"), "by hand").unwrap();
    fs::write(path.join("mine.txt"), "mine").unwrap();

    let second = OutputFolder::open(&path, &policy).unwrap();
    second.check(["summary.json", "new.json"]).unwrap();
    second.write_bytes("summary.json", b"2").unwrap();
    for name in ["edited.json", "mine.txt"] {
        assert!(matches!(
            second.check([name]),
            Err(OutputError::NotOwn { .. })
        ));
        assert!(second.write_bytes(name, b"2").is_err());
    }
    drop(second);
    assert_eq!(fs::read(path.join("summary.json")).unwrap(), b"2");
    assert_eq!(fs::read(path.join("edited.json")).unwrap(), b"by hand");

    let allowed = OutputFolder::open(&path, &policy.overwrite(true)).unwrap();
    allowed.write_bytes("edited.json", b"3").unwrap();
    assert_eq!(fs::read(path.join("edited.json")).unwrap(), b"3");
}

#[test]
fn only_own_unchanged_old_files_are_pruned() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let first = OutputFolder::open(path, &OutputPolicy::new()).unwrap();
    for name in ["1.jpg", "2.jpg", "3.jpg", "4.jpg", "notes.txt"] {
        first.write_bytes(name, name.as_bytes()).unwrap();
    }
    drop(first);
    fs::write(path.join("3.jpg"), "retouched").unwrap();
    fs::write(path.join("mine.jpg"), "mine").unwrap();

    let input = path.join("4.jpg");
    let second = OutputFolder::open(path, &OutputPolicy::new().protect(&input)).unwrap();
    second.write_bytes("1.jpg", b"1.jpg").unwrap();
    let is_photo = |name: &str| name.ends_with(".jpg");
    assert!(matches!(
        second.prune(is_photo),
        Err(OutputError::ReplacesInput { .. })
    ));
    drop(second);
    let third = OutputFolder::open(path, &OutputPolicy::new()).unwrap();
    third.write_bytes("1.jpg", b"1.jpg").unwrap();
    third.prune(is_photo).unwrap();
    let there = |name: &str| path.join(name).exists();
    assert!(there("1.jpg") && there("notes.txt"));
    assert!(there("3.jpg") && there("mine.jpg"), "not ours");
    assert!(!there("2.jpg") && !there("4.jpg"));
    drop(third);
    // What was pruned and comes back by another hand is another's.
    fs::write(path.join("2.jpg"), "2.jpg").unwrap();
    let fourth = OutputFolder::open(path, &OutputPolicy::new()).unwrap();
    assert!(fourth.check(["2.jpg"]).is_err());
    assert!(fourth.check(["notes.txt"]).is_ok());
}

#[test]
fn names_stay_in_the_folder() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    for name in [
        "",
        ".",
        "..",
        "../a",
        "/a",
        "a/b",
        "a/",
        "./a",
        LISTING_NAME,
        "a\0b",
    ] {
        assert!(
            matches!(
                output.write_bytes(name, b""),
                Err(OutputError::BadName { .. })
            ),
            "{name:?}"
        );
        assert!(output.subfolder(name).is_err(), "{name:?}");
    }
    let strange = ["a b", "ü.json", "new\nline", "back\\slash", "two  spaces"];
    for name in strange {
        output.write_bytes(name, b"").unwrap();
    }
    drop(output);
    let again = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    again.check(strange).unwrap();
}

#[test]
fn a_folder_of_any_name_may_be_in_it() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("check")).unwrap();
    let out = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    out.check(["a"]).unwrap();
    out.write_bytes("a", b"1").unwrap();
    out.check(["a"]).unwrap();
    let count = fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(count, 3, "the folder, the file and the list");
}

#[test]
fn one_writer_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let first = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    let clone = first.clone();
    let open = || OutputFolder::open(folder.path(), &OutputPolicy::new());
    if cfg!(unix) {
        assert!(matches!(open(), Err(OutputError::InUse { .. })));
    }
    drop(first);
    clone.subfolder("photos").unwrap();
    drop(clone);
    open().unwrap();
}

#[test]
fn a_file_in_place_of_the_folder_or_of_its_list_is_not_ours() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    assert!(matches!(
        OutputFolder::open(&file, &OutputPolicy::new()),
        Err(OutputError::NotAFolder { .. })
    ));
    fs::write(folder.path().join(LISTING_NAME), "something else\n").unwrap();
    assert!(matches!(
        OutputFolder::open(folder.path(), &OutputPolicy::new().overwrite(true)),
        Err(OutputError::NotOwn { .. })
    ));
}

#[test]
fn a_list_that_a_kill_cut_off_is_used_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    output.write_bytes("a", b"a").unwrap();
    output.write_bytes("b", b"b").unwrap();
    drop(output);
    let list = folder.path().join(LISTING_NAME);
    let text = fs::read(&list).unwrap();
    // Every seventh: each round syncs several files to disk.
    for len in (0..text.len()).rev().step_by(7) {
        fs::write(&list, &text[..len]).unwrap();
        let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
        output.write_bytes("c", b"c").unwrap();
        drop(output);
        let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
        output.check(["c"]).unwrap();
        fs::remove_file(folder.path().join("c")).unwrap();
    }
}

#[test]
fn a_file_written_out_of_order_is_listed_by_its_whole_content() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    let write = |text: &[u8]| {
        output.write("a", |file| {
            file.write_all(b"....")?;
            file.write_all(text)?;
            file.seek(SeekFrom::Start(0))?;
            file.write_all(b"head")
        })
    };
    write(b" and tail").unwrap();
    let path = folder.path().join("a");
    assert_eq!(fs::read(&path).unwrap(), b"head and tail");
    write(b"").unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"head");
}

#[test]
fn a_file_that_other_code_wrote_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    output.check(["curves.csv"]).unwrap();
    fs::write(folder.path().join("curves.csv"), "1,2").unwrap();
    assert!(output.check(["curves.csv"]).is_err());
    output.record("curves.csv").unwrap();
    output.check(["curves.csv"]).unwrap();
}

#[test]
fn the_list_of_a_file_that_is_replaced_often_stays_short() {
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join(LISTING_NAME);
    let longest = |output: &OutputFolder, round: u32| {
        let text = format!("checkpoint of step {round}");
        output.write_bytes("checkpoint", text.as_bytes()).unwrap();
        fs::write(folder.path().join("curves.csv"), text).unwrap();
        output.record("curves.csv").unwrap();
        fs::read_to_string(&list).unwrap().lines().count()
    };
    for run in 0..3 {
        let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
        let lines = (0..40).map(|round| longest(&output, 100 * run + round));
        assert!(lines.max() < Some(24));
    }
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    output.check(["checkpoint", "curves.csv"]).unwrap();
    drop(output);
    fs::write(folder.path().join("checkpoint"), "something else").unwrap();
    let output = OutputFolder::open(folder.path(), &OutputPolicy::new()).unwrap();
    assert!(output.check(["checkpoint"]).is_err());
}

#[test]
fn inputs_that_become_known_are_spared_in_open_folders() {
    let folder = tempfile::tempdir().unwrap();
    let policy = OutputPolicy::new().overwrite(true);
    let output = OutputFolder::open(folder.path(), &policy).unwrap();
    let photos = output.subfolder("photos").unwrap();
    fs::write(photos.path().join("a.jpg"), "a photo").unwrap();
    let mut partial = photos.create_partial("a.jpg").unwrap();
    partial.write_all(b"other").unwrap();
    policy.add_input_trees([photos.path()]);
    let refused = [partial.commit(), photos.write_bytes("a.jpg", b"other")];
    for refused in refused {
        assert!(matches!(refused, Err(OutputError::InInputFolder { .. })));
    }
    assert_eq!(fs::read(photos.path().join("a.jpg")).unwrap(), b"a photo");
}

#[test]
fn a_run_that_writes_nothing_leaves_no_folder() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("a/b");
    let open = || OutputFolder::open(&path, &OutputPolicy::new()).unwrap();
    let output = open();
    let matches = output.subfolder("matches").unwrap();
    output.check(["summary.json"]).unwrap();
    let file = matches.create("1.jpg").unwrap();
    // In whatever order they are dropped.
    drop(output);
    drop(matches);
    assert!(path.join("matches").is_dir());
    drop(file);
    assert!(!parent.path().join("a").exists());

    // What was there before stays, and what holds something.
    fs::create_dir(parent.path().join("a")).unwrap();
    drop(open());
    assert!(parent.path().join("a").is_dir() && !path.exists());
    let output = open();
    drop(output.subfolder("matches").unwrap());
    output.write_bytes("summary.json", b"{}").unwrap();
    drop(output);
    assert!(path.join("summary.json").is_file() && !path.join("matches").exists());
}
