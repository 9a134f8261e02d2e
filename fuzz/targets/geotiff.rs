//! GeoTIFF maps: opened, placed, and read in a corner and as a whole.
#![no_main]

use grimnet_fuzz_targets::usable::assert_usable;
use grimnet_fuzz_targets::{assert_named, file_of};
use grimnet_geo::{MapOptions, open_map};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(bytes, "map.tif");
    match open_map(&path, &MapOptions::default()) {
        Ok(map) => assert_usable(&*map),
        Err(error) => assert_named(&error, "map."),
    }
});
