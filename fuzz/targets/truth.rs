//! Truth files of `grim eval`.
#![no_main]

use grimnet_eval::datasets::truth;
use grimnet_fuzz_targets::{assert_named, file_of};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(bytes, "truth.csv");
    match truth::read_rows(&path) {
        Ok((frames, _)) => {
            for place in frames.iter().filter_map(|frame| frame.position()) {
                assert!(place.lat_deg.abs() <= 90.0 && place.lon_deg.is_finite());
            }
        }
        Err(error) => assert_named(&error, "truth.csv"),
    }
});
