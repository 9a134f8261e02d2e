//! Outputs of one run that would meet.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::fs;
use std::os::unix::fs::symlink;

use grimnet_output::{OutputError, PlannedOutput, check_apart};

#[test]
fn outputs_that_meet_are_refused_by_the_names_of_both() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir_all(at("there/sub")).unwrap();
    symlink(at("there"), at("link")).unwrap();
    symlink("new/track.gpx", at("dangling")).unwrap();
    let file = |name: &str| PlannedOutput::file("-o", at(name));
    let results = |name: &str| PlannedOutput::folder("--report", at(name), ["report.html"]);
    let meet = |a: &PlannedOutput, b: &PlannedOutput| {
        let one_way = check_apart(&[a.clone(), b.clone()]);
        assert_eq!(
            one_way.is_err(),
            check_apart(&[b.clone(), a.clone()]).is_err()
        );
        matches!(one_way, Err(OutputError::Meet { .. }))
    };
    for (a, b) in [
        ("a.html", "a.html"),
        ("there/a.html", "there/sub/../a.html"),
        ("there/a.html", "link/a.html"),
        ("dangling", "new/track.gpx"),
        ("new/sub/../a.html", "new/a.html"),
        ("a.html", "a.html.partial"),
        ("a.html", "a.html.partial-2"),
    ] {
        assert!(meet(&file(a), &file(b)), "{a} {b}");
    }
    for (a, b) in [
        ("a.html", "b.html"),
        ("a.html", "a.html.partially"),
        ("there/a.html", "a.html"),
    ] {
        assert!(!meet(&file(a), &file(b)), "{a} {b}");
    }
    for (name, of_folder) in [
        ("new", "new"),
        ("new", "new/report"),
        ("new/report.html", "new"),
        ("new/report.html.partial", "new"),
        ("link/.grim-output", "there"),
    ] {
        assert!(meet(&file(name), &results(of_folder)), "{name} {of_folder}");
    }
    for (name, of_folder) in [("new/a.html", "new"), ("report.html", "new")] {
        assert!(
            !meet(&file(name), &results(of_folder)),
            "{name} {of_folder}"
        );
    }
    assert!(meet(&results("there"), &results("link")));
    assert!(!meet(&results("there"), &results("there/sub")));
    let text = check_apart(&[file("new/report.html"), file("b"), results("new")])
        .unwrap_err()
        .to_string();
    assert!(
        text.starts_with("-o and --report would both write "),
        "{text}"
    );
}

#[test]
fn devices_take_several_outputs_and_standard_output_takes_one() {
    let null = |option| PlannedOutput::file(option, "/dev/null");
    assert!(check_apart(&[null("-o"), null("--nmea")]).is_ok());
    let standard = PlannedOutput::standard_output;
    assert!(check_apart(&[standard("-o"), standard("--nmea")]).is_err());
    assert!(check_apart(&[standard("-o"), null("--nmea")]).is_ok());
}
