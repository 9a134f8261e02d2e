//! Every command that reads photos limits their memory, and says which option raises the limit.

use std::fs;

use predicates::prelude::*;
use predicates::str::contains;

use super::{demo, grim, lines, pack, photo};

/// What the refusal of a photo says at a limit of 1 MiB.
const REFUSAL: &str = "the limit for a photo is 1 MiB";

const ONE_MIB: [&str; 2] = ["--max-photo-memory", "1"];

#[test]
fn a_frame_of_a_track_above_the_limit_is_unusable_and_is_not_read_whole() {
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("large_1.5.tif");
    fs::File::create(&large)
        .unwrap()
        .set_len(2_500_000_000)
        .unwrap();
    let names = format!("{}\n", large.display());
    for (source, limit, says) in [
        (photo(1), &ONE_MIB[..], REFUSAL),
        (large, &[], "has 2.3 GiB; the limit"),
        ("-".into(), &[], "has 2.3 GiB; the limit"),
    ] {
        let mut command = grim();
        command.args(["track", "--fps", "1", "--pack"]);
        let output = command
            .arg(pack())
            .arg(source)
            .args(limit)
            .write_stdin(names.clone())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(1));
        let answers = lines(&String::from_utf8(output.stdout).unwrap());
        assert_eq!(answers[0]["frame"], "unusable");
        let reason = answers[0]["reason"].as_str().unwrap();
        for word in [says, "--max-photo-memory"] {
            assert!(reason.contains(word), "{word}: {reason}");
        }
    }
}

#[test]
fn photos_of_an_evaluation_have_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    let pictures = data.join("photos");
    fs::create_dir_all(&pictures).unwrap();
    fs::copy(photo(1), pictures.join("flight_001.jpg")).unwrap();
    let truth = fs::read_to_string(demo().join("truth.csv")).unwrap();
    let rows: Vec<&str> = truth.lines().take(2).collect();
    fs::write(data.join("truth.csv"), rows.join("\n")).unwrap();
    let out = folder.path().join("out");
    let eval = |arguments: &[&str]| {
        let mut command = grim();
        command.arg("eval").arg("--map").arg(demo().join("map.tif"));
        command.args(arguments).arg("--out").arg(&out);
        command.args(ONE_MIB);
        command
    };
    eval(&[data.to_str().unwrap(), "--heading", "exif"])
        .assert()
        .success()
        .stderr(contains("counts as a photo without a fix").and(contains(REFUSAL)));
    let failed = fs::read_to_string(out.join("failed.jsonl")).unwrap();
    assert!(failed.contains(REFUSAL), "{failed}");
    eval(&["--elsewhere", pictures.to_str().unwrap()])
        .assert()
        .stderr(contains(REFUSAL));
}

#[test]
fn a_photo_that_tells_the_resolution_of_a_pack_has_the_limit() {
    let folder = tempfile::tempdir().unwrap();
    grim()
        .args(["map", "build", "-o"])
        .arg(folder.path().join("x.grim"))
        .arg(demo().join("map.tif"))
        .arg("--photo")
        .arg(photo(1))
        .args(ONE_MIB)
        .assert()
        .code(2)
        .stderr(contains(REFUSAL).and(contains("--max-photo-memory")));
}

#[test]
#[cfg(feature = "serve")]
fn photos_that_clients_send_have_the_limit() {
    let pack = pack();
    let [option, limit] = ONE_MIB;
    let arguments = ["--pack", pack.to_str().unwrap(), option, limit];
    let service = super::serve::Service::start(&arguments);
    let bytes = fs::read(photo(1)).unwrap();
    let answer = service.ask("POST /v1/locate", "content-type: image/jpeg\r\n", &bytes);
    assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
    assert!(answer.contains(REFUSAL), "{answer}");
}
