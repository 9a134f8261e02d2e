//! The same fixes on any instruction set and number of threads, within the tolerance that SECURITY.md states; the same pack, byte for
//! byte, on any number of threads.

use std::path::{Path, PathBuf};

use grimnet_kernels::{ISA_VARIABLE, Isa};
use serde_json::Value;

use super::{demo, grim, lines, photo};

/// Largest distance of two fixes, and largest difference of two stated radii, metres.
const TOLERANCE_M: f64 = 0.01;
/// Largest difference of two confidences.
const TOLERANCE_CONFIDENCE: f64 = 0.001;
/// Metres of a degree of latitude; the demo lies at the equator.
const DEGREE_M: f64 = 111_195.0;

/// `grim locate` on an instruction set and a number of threads.
fn answers(pack: &Path, isa: Isa, threads: u32, heading: &str, photos: &[PathBuf]) -> Vec<Value> {
    let output = grim()
        .args(["locate", "--heading", heading, "--threads"])
        .arg(threads.to_string())
        .arg("--pack")
        .arg(pack)
        .args(photos)
        .env(ISA_VARIABLE, isa.to_string())
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!errors.contains(ISA_VARIABLE), "{errors}");
    let mut answers = lines(&String::from_utf8(output.stdout).unwrap());
    for answer in &mut answers {
        answer["time_ms"].take();
    }
    answers
}

/// A pack of the demo's map at one coarse level.
fn build(out: &Path, isa: Isa, threads: u32) {
    grim()
        .args(["map", "build", "--gsd", "0.6", "--threads"])
        .arg(threads.to_string())
        .arg(demo().join("map.tif"))
        .arg("-o")
        .arg(out)
        .env(ISA_VARIABLE, isa.to_string())
        .assert()
        .success();
}

fn assert_same_fix(a: &Value, b: &Value, text: &str) {
    assert_eq!((&a["state"], &b["state"]), (&"fix".into(), &"fix".into()));
    let difference = |name: &str| (a[name].as_f64().unwrap() - b[name].as_f64().unwrap()).abs();
    let off_m = DEGREE_M * difference("lat_deg").hypot(difference("lon_deg"));
    assert!(off_m <= TOLERANCE_M, "{text}: {off_m} m apart");
    assert!(difference("radius95_m") <= TOLERANCE_M, "{text}: {a} {b}");
    let confidence = difference("confidence");
    assert!(confidence <= TOLERANCE_CONFIDENCE, "{text}: {a} {b}");
}

#[test]
fn fixes_are_the_same_on_any_instruction_set_and_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let sets = Isa::available();
    let photos = [photo(1), photo(2)];
    let packs: Vec<PathBuf> = sets
        .iter()
        .map(|&isa| {
            let path = folder.path().join(format!("{isa}.grim"));
            build(&path, isa, 2);
            path
        })
        .collect();
    for heading in ["exif", "unknown"] {
        let expected = answers(&packs[0], Isa::Portable, 2, heading, &photos);
        for (pack, &isa) in packs.iter().zip(&sets) {
            // Built and used by one set of instructions; built by it and used by the plain one.
            let own = answers(pack, isa, 2, heading, &photos);
            let on_one_thread = answers(pack, isa, 1, heading, &photos);
            assert_eq!(own, on_one_thread, "{isa}: threads change an answer");
            let foreign = answers(pack, Isa::Portable, 2, heading, &photos[..1]);
            for (found, place) in [(own, "built and used"), (foreign, "built")] {
                for (a, b) in expected.iter().zip(&found) {
                    assert_same_fix(a, b, &format!("{place} on {isa}, heading {heading}"));
                }
            }
        }
    }
}

#[test]
fn a_pack_has_the_same_bytes_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |threads| {
        let path = folder.path().join("area.grim");
        build(&path, Isa::detect(), threads);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        bytes
    };
    let one = bytes(1);
    assert!(one == bytes(2) && one == bytes(5));
}
