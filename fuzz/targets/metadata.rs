//! EXIF blocks and XMP packets, in a JPEG and by themselves. The EXIF block ends where the XMP packet begins.
#![no_main]

use grimnet_fuzz_targets::assert_named;
use grimnet_photo::{Metadata, Photo, PhotoLimits, ViewPrior};
use libfuzzer_sys::fuzz_target;

const JPEG: &[u8] = include_bytes!("../corpus/photo/restart.jpg");
const XMP: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
const MAX_MEMORY_BYTES: u64 = 8 << 20;

/// An APP1 segment; the rest of a body that is too long is left out.
fn app1(head: &[u8], body: &[u8]) -> Vec<u8> {
    let body = &body[..body.len().min(60_000)];
    let length = (2 + head.len() + body.len()) as u16;
    [&[0xFF, 0xE1], &length.to_be_bytes()[..], head, body].concat()
}

fuzz_target!(|bytes: &[u8]| {
    let packet = bytes
        .windows(2)
        .position(|window| window == b"<x")
        .unwrap_or(bytes.len());
    let (exif, xmp) = bytes.split_at(packet);
    let file = [
        &JPEG[..2],
        &app1(b"Exif\0\0", exif),
        &app1(XMP, xmp),
        &JPEG[2..],
    ]
    .concat();
    let limits = PhotoLimits::of_memory(MAX_MEMORY_BYTES);
    match Photo::from_bytes_within("frame_0042", &file, Some(64), &limits) {
        Ok(photo) => check(&photo),
        Err(error) => assert_named(&error, "frame_0042"),
    }
    // By themselves they are a TIFF, or nothing.
    let _ = Metadata::from_bytes(bytes);
});

fn check(photo: &Photo) {
    let metadata = &photo.metadata;
    if let Some(position) = metadata.position {
        assert!(position.lat_deg.abs() <= 90.0 && position.lon_deg.abs() <= 180.0);
    }
    assert!((1..=8).contains(&metadata.orientation));
    if let Some(footprint) = photo.view(&ViewPrior::default()).footprint {
        assert!(footprint.width_m.is_finite() && footprint.width_m > 0.0);
    }
}
