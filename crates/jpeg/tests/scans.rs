//! Baseline files with a scan for each colour, and frames without Huffman tables (`golden/make_golden.py`).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use grimnet_jpeg::{Jpeg, JpegError, Reduction};

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

/// Webcams leave them out. The golden file has the standard ones.
#[test]
fn frames_of_motion_jpeg_without_tables_have_the_standard_ones() {
    let whole = golden("422");
    let mut frame = b"\xFF\xD8\xFF\xE0\x00\x07AVI1\0".to_vec();
    let mut at = 2;
    while whole[at + 1] != 0xDA {
        let length = usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
        let segment = &whole[at..at + 2 + length];
        if !matches!(segment[1], 0xC4 | 0xE0) {
            frame.extend(segment);
        }
        at += segment.len();
    }
    frame.extend(&whole[at..]);
    assert!(frame.len() + 400 < whole.len());
    let (frame, whole) = (Jpeg::read(&frame).unwrap(), Jpeg::read(&whole).unwrap());
    let decoded = frame.decode().unwrap();
    assert_eq!(decoded.damage, None);
    assert_eq!(decoded.image, whole.decode().unwrap().image);
    let reduced = frame.decode_reduced(Reduction::Half).unwrap();
    assert_eq!(reduced.damage, None);
    let expected = whole.decode_reduced(Reduction::Half).unwrap();
    assert_eq!(reduced.image, expected.image);
}
