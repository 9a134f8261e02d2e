//! A build that is stopped at any moment continues where it was, and ends with the same bytes.

#![allow(clippy::unwrap_used)] // helpers outside of test functions fail the test that calls them

mod support;

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::Command;

use grimnet_geo::{GeoError, Georeference, Raster, RasterPatch, WindowPx};
use grimnet_pack::{
    BuildLimits, BuildOptions, Levels, Pack, PackError, Phase, build, build_interruptible, estimate,
};
use support::*;

fn map() -> TestMap {
    let mut map = TestMap::new(2500, 2300);
    map.nodata_left = 400;
    map
}

fn options() -> BuildOptions {
    BuildOptions {
        levels: Levels::Gsd(vec![0.25, 0.5]),
        adapt: true,
        ..indexed()
    }
}

/// Builds until `calls` progress reports were made, then dies without tidying up.
fn die_after(calls: usize, options: &BuildOptions, out: &Path) {
    let mut seen = 0;
    let stopped = catch_unwind(AssertUnwindSafe(|| {
        build(&map(), &tiny_model(1), options, out, &mut |_| {
            seen += 1;
            assert!(seen < calls, "stopped by the test");
        })
    }));
    assert!(stopped.is_err(), "{calls} reports were too many");
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// A map under another name, whose files may be changed while it is read.
struct Altered {
    map: TestMap,
    name: &'static str,
    hash_now: Option<[u8; 32]>,
}

impl Raster for Altered {
    fn size_px(&self) -> (u64, u64) {
        self.map.size_px()
    }

    fn georeference(&self) -> &Georeference {
        self.map.georeference()
    }

    fn content_hash(&self) -> Result<[u8; 32], GeoError> {
        self.map.content_hash()
    }

    fn content_hash_now(&self) -> Result<[u8; 32], GeoError> {
        self.hash_now.map_or_else(|| self.content_hash(), Ok)
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        self.map.read(window, out_w, out_h)
    }

    fn describe(&self) -> String {
        self.name.to_owned()
    }
}

#[test]
fn a_map_that_changes_meanwhile_gives_no_pack_and_nothing_to_continue() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let error = build(
        &Altered {
            map: map(),
            name: "town.tif",
            hash_now: Some([7; 32]),
        },
        &tiny_model(1),
        &options(),
        &out,
        &mut |_| (),
    )
    .unwrap_err();
    assert!(
        matches!(&error, PackError::MapChanged { .. }) && error.to_string().contains("town.tif"),
        "{error}"
    );
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn a_renamed_map_is_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let make_renamed = || {
        build(
            &Altered {
                map: map(),
                name: "renamed.tif",
                hash_now: None,
            },
            &tiny_model(1),
            &options(),
            &out,
            &mut |_| (),
        )
        .unwrap()
    };
    die_after(4, &options(), &out);
    let report = make_renamed();
    assert!(report.tiles_resumed > 0);
    assert!(make(&map(), &options(), &out).unwrap().was_complete);
    assert!(make_renamed().was_complete);
}

#[test]
fn a_resolution_far_finer_than_the_map_is_a_slip_of_units() {
    let folder = tempfile::tempdir().unwrap();
    let options = BuildOptions {
        levels: Levels::Gsd(vec![0.001]),
        ..options()
    };
    let out = folder.path().join("area.grim");
    let error = build(&map(), &tiny_model(1), &options, &out, &mut |_| ()).unwrap_err();
    assert!(error.to_string().contains("enlarged"), "{error}");
    // What `--height-agl` and `--hfov` of `grim map build` give.
    assert!(error.to_string().contains("field of view"), "{error}");
    assert_eq!(names(folder.path()), [""; 0]);
    let limits = BuildLimits::default();
    let estimated = estimate(&map(), &tiny_model(1), &options, &limits);
    assert_eq!(estimated.unwrap_err().to_string(), error.to_string());
}

#[test]
fn a_caller_can_end_a_build_and_continue_it() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, out) = (
        folder.path().join("whole.grim"),
        folder.path().join("area.grim"),
    );
    build(&map(), &tiny_model(1), &options(), &whole, &mut |_| ()).unwrap();
    let limits = BuildLimits::default();
    let mut seen = 0;
    let stopped = build_interruptible(
        &map(),
        &tiny_model(1),
        &options(),
        &limits,
        &out,
        &mut |_| {
            seen += 1;
            if seen < 4 {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        },
    );
    let error = stopped.unwrap_err();
    assert!(matches!(error, PackError::Stopped { .. }), "{error}");
    assert!(error.to_string().contains("area.grim.partial"), "{error}");
    assert_eq!(seen, 4, "nothing more is done");
    assert_eq!(names(folder.path()), ["area.grim.partial", "whole.grim"]);
    let report = make(&map(), &options(), &out).unwrap();
    assert!(report.tiles_resumed > 0);
    assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&whole).unwrap());
}

#[test]
fn stopped_at_any_report_or_byte_the_same_bytes_come_out() {
    for options in [options(), paper()] {
        let folder = tempfile::tempdir().unwrap();
        let whole = folder.path().join("whole.grim");
        let mut reports = 0;
        build(&map(), &tiny_model(1), &options, &whole, &mut |_| {
            reports += 1
        })
        .unwrap();
        let expected = std::fs::read(&whole).unwrap();
        assert_eq!(
            names(folder.path()),
            ["whole.grim"],
            "nothing is left beside the pack"
        );
        for calls in [1, 2, 4, reports / 2, reports - 1, reports] {
            let folder = tempfile::tempdir().unwrap();
            let out = folder.path().join("area.grim");
            die_after(calls, &options, &out);
            assert_eq!(names(folder.path()), ["area.grim.partial"]);
            // The last record may be torn, too.
            let journal = folder.path().join("area.grim.partial");
            let len = std::fs::metadata(&journal).unwrap().len();
            let cut = len - (calls as u64 * 37) % (len / 3);
            std::fs::File::options()
                .write(true)
                .open(&journal)
                .unwrap()
                .set_len(cut)
                .unwrap();
            let report = make(&map(), &options, &out).unwrap();
            assert!(!report.was_complete);
            if calls > 4 {
                assert!(report.tiles_resumed > 0);
            }
            assert!(
                std::fs::read(&out).unwrap() == expected,
                "stopped at report {calls}"
            );
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let bytes = |threads| {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("area.grim");
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| make(&map(), &options(), &out)).unwrap();
        std::fs::read(&out).unwrap()
    };
    assert!(bytes(1) == bytes(5));
}

/// Run by the next test in a process of its own.
#[test]
fn child_that_is_killed() {
    let Ok(out) = std::env::var("GRIMNET_TEST_KILLED_BUILD") else {
        return;
    };
    let mut reports = 0;
    let _ = build(
        &map(),
        &tiny_model(1),
        &options(),
        Path::new(&out),
        &mut |_| {
            reports += 1;
            if reports == 6 {
                std::process::abort();
            }
        },
    );
}

#[test]
fn a_killed_process_leaves_the_old_pack_and_its_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    make(&map(), &one_level(), &out).unwrap();
    let old = std::fs::read(&out).unwrap();
    let status = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "child_that_is_killed"])
        .env("GRIMNET_TEST_KILLED_BUILD", &out)
        .output()
        .unwrap()
        .status;
    assert!(!status.success());
    assert!(
        std::fs::read(&out).unwrap() == old,
        "what was there is intact"
    );
    let report = make(&map(), &options(), &out).unwrap();
    assert!(report.tiles_resumed > 0 && report.tiles > report.tiles_resumed);
    assert_eq!(Pack::open(&out).unwrap().levels().len(), 2);
    assert_eq!(names(folder.path()), ["area.grim"]);
}

/// A kill between renaming the pack and deleting the journal.
#[test]
fn a_journal_that_a_finished_build_left_is_deleted_by_the_next_one() {
    let folder = tempfile::tempdir().unwrap();
    let (out, journal) = (
        folder.path().join("area.grim"),
        folder.path().join("area.grim.partial"),
    );
    let mut left = Vec::new();
    let build_one = |options: &BuildOptions, left: &mut Vec<u8>| {
        build(&map(), &tiny_model(1), options, &out, &mut |progress| {
            if progress.phase == Phase::Writing {
                *left = std::fs::read(&journal).unwrap();
            }
        })
        .unwrap()
    };
    build_one(&options(), &mut left);
    let of_another_build = left.clone();
    build_one(&one_level(), &mut left);
    assert_eq!(names(folder.path()), ["area.grim"]);
    for (bytes, stays) in [(left, false), (of_another_build, true)] {
        std::fs::write(&journal, &bytes).unwrap();
        let report = build_one(&one_level(), &mut Vec::new());
        assert!(report.was_complete);
        assert_eq!(journal.exists(), stays);
    }
}

#[test]
fn a_second_writer_is_refused_and_the_first_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let mut refused = false;
    build(
        &map(),
        &tiny_model(1),
        &one_level(),
        &out,
        &mut |progress| {
            if progress.phase == Phase::Tiles && !refused {
                let error = make(&map(), &one_level(), &out).unwrap_err();
                refused = matches!(error, PackError::Busy { .. });
            }
        },
    )
    .unwrap();
    assert!(refused);
    Pack::open(&out).unwrap().verify(&mut |_| {}).unwrap();
}

#[test]
fn another_map_model_or_option_starts_from_the_beginning() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    die_after(6, &options(), &out);
    let report = make(&map(), &one_level(), &out).unwrap();
    assert_eq!(report.tiles_resumed, 0);
    // The same again: nothing to do. Another model: everything to do.
    let again = make(&map(), &one_level(), &out).unwrap();
    assert!(again.was_complete && again.tiles == report.tiles);
    let other = build(&map(), &tiny_model(2), &one_level(), &out, &mut |_| {}).unwrap();
    assert!(!other.was_complete);
    Pack::open(&out)
        .unwrap()
        .check_model(&tiny_model(2))
        .unwrap();
}

#[test]
fn progress_adds_up() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let mut last = None;
    let mut done = 0;
    build(&map(), &tiny_model(1), &options(), &out, &mut |p| {
        assert!(
            p.tiles_done >= done
                && p.tiles_done <= p.tiles_total
                && p.tiles_skipped <= p.tiles_done
        );
        done = p.tiles_done;
        last = Some(p.clone());
    })
    .unwrap();
    let (last, pack) = (last.unwrap(), Pack::open(&out).unwrap());
    assert_eq!(
        (last.phase, last.tiles_done),
        (Phase::Writing, last.tiles_total)
    );
    let tiles: u64 = pack.manifest().levels.iter().map(|l| l.tiles).sum();
    assert_eq!(tiles + last.tiles_skipped, last.tiles_total);
    assert!(last.tiles_skipped > 0 && last.tiles_per_s > 0.0);
}

#[test]
fn working_files_of_others_are_refused_and_stay() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    for (name, notes) in [
        ("area.grim.partial", "notes"),
        ("area.grim.assembling", "notes"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, notes).unwrap();
        let error = make(&map(), &options(), &out).unwrap_err();
        assert!(matches!(error, PackError::InTheWay { .. }), "{error}");
        assert!(error.to_string().contains(name), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), notes);
        std::fs::remove_file(&path).unwrap();
    }
    assert!(!out.exists());
    // What a killed build leaves while it assembles: nothing, the place of the header, or all but the renaming.
    make(&map(), &one_level(), &out).unwrap();
    let whole = std::fs::read(&out).unwrap();
    for left in [&[][..], &[0; 10], &[0; 64], &whole] {
        std::fs::write(folder.path().join("area.grim.assembling"), left).unwrap();
        std::fs::remove_file(&out).unwrap();
        make(&map(), &one_level(), &out).unwrap();
        assert_eq!(names(folder.path()), ["area.grim"]);
    }
}

#[test]
fn a_file_that_comes_to_the_path_during_a_build_stays() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("area.grim");
    let (map, model) = (map(), tiny_model(1));
    for notes in ["of somebody else", "of somebody else, longer"] {
        let built = build(&map, &model, &one_level(), &out, &mut |_| {
            std::fs::write(&out, notes).unwrap();
        });
        let error = built.unwrap_err();
        assert!(matches!(error, PackError::Output { .. }), "{error}");
        assert!(error.to_string().contains("area.grim"), "{error}");
        assert_eq!(std::fs::read_to_string(&out).unwrap(), notes);
        // The work is not lost.
        assert_eq!(names(folder.path()), ["area.grim", "area.grim.partial"]);
    }
    std::fs::remove_file(&out).unwrap();
    assert!(make(&map, &one_level(), &out).unwrap().tiles_resumed > 0);
    assert_eq!(names(folder.path()), ["area.grim"]);
}

/// Else they could be on another disk, from which nothing can be renamed.
#[test]
#[cfg(unix)]
fn working_files_are_where_a_link_leads_to() {
    let folder = tempfile::tempdir().unwrap();
    let (here, there) = (folder.path().join("here"), folder.path().join("there"));
    std::fs::create_dir(&here).unwrap();
    std::fs::create_dir(&there).unwrap();
    let link = here.join("link.grim");
    std::os::unix::fs::symlink("../there/area.grim", &link).unwrap();
    die_after(4, &options(), &link);
    assert_eq!(names(&here), ["link.grim"]);
    assert_eq!(names(&there), ["area.grim.partial"]);
    assert!(make(&map(), &options(), &link).unwrap().tiles_resumed > 0);
    assert!(link.is_symlink());
    assert_eq!(names(&there), ["area.grim"]);
}
