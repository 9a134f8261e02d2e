//! A training run of some seconds.
#![cfg(feature = "train")]

use std::path::Path;

use super::noise_map;

/// Writes twelve small pictures beside `config`, and a configuration that trains on them and writes into the folder `run` of the folder
/// that the command is started in.
pub fn write_config(config: &Path, seed: u32, steps: u32) {
    let pictures = config.with_file_name("pictures");
    std::fs::create_dir_all(&pictures).unwrap();
    for number in 0..12 {
        noise_map(&pictures.join(format!("{number}.png")), 110, number + 1);
    }
    let text = format!(
        "out = \"run\"\nseed = {seed}\nsteps = {steps}\npairs_per_step = 2\nreport_steps = 1\nglobal_from = 0.0\n\
         memory_batches = 0\nvalidate_minutes = 0.0\ncheckpoint_minutes = 0.0\n\
         [[data]]\npath = '{}'\n\
         [pairs]\nside_px = 64\npoints = 12\n\
         [export]\nwhitening_pairs = 0\nvalidation_pairs = 2\ndistractors = 0\n",
        pictures.display()
    );
    std::fs::write(config, text).unwrap();
}
