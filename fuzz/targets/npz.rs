//! Archives of NumPy arrays, as AnyVisLoc has them, within 1 MiB an array.
#![no_main]

use grimnet_eval::datasets::npz::Npz;
use grimnet_fuzz_targets::{assert_named, file_of};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(bytes, "L01_0042.npz");
    let archive = match Npz::open(&path) {
        Ok(archive) => archive,
        Err(error) => return assert_named(&error, "L01_0042.npz"),
    };
    let mut archive = archive.with_max_array_bytes(1 << 20);
    for name in ["a", "arr_0", "uav_image"] {
        // Whoever asks for an array names the file.
        if let Err(error) = archive.floats(name) {
            assert_named(&error, name);
        }
        let _ = archive.bytes(name);
    }
});
