//! Model files, their checksum made right.
#![no_main]

use grimnet_fuzz_targets::{assert_named, file_of};
use grimnet_net::Model;
use libfuzzer_sys::fuzz_target;

const PREFIX: &[u8] = b"\"checksum\":\"";
const DIGITS: usize = 64;

/// Makes the checksum of the file right, if its header has one.
fn with_checksum(mut file: Vec<u8>) -> Vec<u8> {
    let at = file
        .windows(PREFIX.len())
        .position(|window| window == PREFIX)
        .map(|at| at + PREFIX.len());
    if let Some(at) = at.filter(|at| at + DIGITS <= file.len()) {
        file[at..at + DIGITS].fill(b'0');
        let checksum = blake3::hash(&file).to_hex();
        file[at..at + DIGITS].copy_from_slice(checksum.as_bytes());
    }
    file
}

fuzz_target!(|bytes: &[u8]| {
    let path = file_of(&with_checksum(bytes.to_vec()), "new.safetensors");
    if let Err(error) = Model::open(&path) {
        assert_named(&error, "new.safetensors");
    }
});
