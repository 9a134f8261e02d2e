//! Telemetry files: CSV, SRT and KLV.
#![no_main]

use grimnet_fuzz_targets::{assert_named, file_of};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(bytes, "flight_0042");
    match grimnet_link::read_telemetry(&path) {
        Ok(telemetry) => {
            for input in telemetry.inputs {
                assert!(input.time_s().is_finite(), "{input:?}");
            }
        }
        Err(error) => assert_named(&error, "flight_0042"),
    }
});
