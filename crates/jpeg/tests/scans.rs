//! Baseline files with a scan for each colour (`golden/make_golden.py`).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_jpeg::{Jpeg, JpegError};

fn golden(file: &str) -> Vec<u8> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden");
    std::fs::read(format!("{folder}/{file}.jpg")).unwrap()
}

#[test]
fn colours_of_one_size_are_those_of_a_single_scan() {
    let (apart, together) = (golden("444_scans"), golden("444"));
    let decoded = Jpeg::read(&apart).unwrap().decode().unwrap();
    assert_eq!(decoded.damage, None);
    assert_eq!(
        decoded.image,
        Jpeg::read(&together).unwrap().decode().unwrap().image
    );
}

/// The decoder would give a green picture, with the upper left part of the brightness.
#[test]
fn subsampled_colours_are_refused() {
    let error = Jpeg::read(&golden("420_scans")).unwrap_err();
    assert!(matches!(&error, JpegError::Unsupported(what) if what.contains("several scans")));
}
