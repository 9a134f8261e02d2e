//! Photos of all formats with their metadata, within 8 MiB.
#![no_main]

use grimnet_fuzz_targets::assert_named;
use grimnet_photo::{MIN_SIDE_PX, Photo, PhotoLimits, ViewPrior};
use libfuzzer_sys::fuzz_target;

const MAX_MEMORY_BYTES: u64 = 8 << 20;

fuzz_target!(|bytes: &[u8]| {
    let limits = PhotoLimits::of_memory(MAX_MEMORY_BYTES);
    let photo = match Photo::from_bytes_within("frame_0042", bytes, Some(64), &limits) {
        Ok(photo) => photo,
        Err(error) => return assert_named(&error, "frame_0042"),
    };
    let (width, height) = photo.full_size_px;
    assert!(width.min(height) >= MIN_SIDE_PX);
    assert!(3 * u64::from(width) * u64::from(height) <= MAX_MEMORY_BYTES);
    if let Some(position) = photo.metadata.position {
        assert!(position.lat_deg.abs() <= 90.0 && position.lon_deg.abs() <= 180.0);
    }
    assert!((1..=8).contains(&photo.metadata.orientation));
    if let Some(footprint) = photo.view(&ViewPrior::default()).footprint {
        assert!(footprint.width_m.is_finite() && footprint.width_m > 0.0);
    }
});
