//! Faults that users meet, and the answers to them. `README.md` lists all of them with their tests, here and in other crates.

mod answers;
mod coverage;
mod folders;
mod full_disk;
mod kills;
pub(crate) mod observations;
pub(crate) mod training;
mod whole;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Every file below a folder with its content; paths from the folder. Lists of outputs and locks are left out.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        for entry in fs::read_dir(&path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.file_name().unwrap() != ".grim-output" {
                let name = path.strip_prefix(folder).unwrap().to_owned();
                found.insert(name, fs::read(path).unwrap());
            }
        }
    }
    found
}

/// A map of noise of this side, pixels, and the options that place it.
pub fn noise_map(path: &Path, side_px: u32, seed: u32) -> [&'static str; 2] {
    let mut state = seed;
    let noise = image::RgbImage::from_fn(side_px, side_px, |_, _| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let bytes = state.to_be_bytes();
        image::Rgb([bytes[0], bytes[1], bytes[0] ^ bytes[1]])
    });
    noise.save(path).unwrap();
    ["--corners", "13.400,52.500,13.404,52.5025"]
}
