//! Writes training pairs as PNG files for inspection: `pairs CONFIG.toml OUT_DIR`.

#![allow(clippy::print_stdout)]

use grimnet_train::data::batch_of;
use grimnet_train::{Data, TrainConfig};
use image::{Rgb, RgbImage};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, config, out] = &arguments[..] else {
        return Err("usage: pairs CONFIG.toml OUT_DIR".into());
    };
    let config = TrainConfig::open(Path::new(config))?;
    let data = Data::open(&config)?;
    std::fs::create_dir_all(out)?;
    for step in 0..6 {
        let started = Instant::now();
        let batch = batch_of(
            &data.training,
            None,
            &config.pairs,
            config.pairs_per_step,
            config.seed,
            step,
        );
        println!(
            "batch {step}: {} pairs in {:?}",
            batch.len(),
            started.elapsed()
        );
        let side = config.pairs.side_px;
        let mut sheet = RgbImage::new(side * batch.len() as u32, side * 2);
        for (i, pair) in batch.iter().enumerate() {
            let left = i as u32 * side;
            image::imageops::replace(&mut sheet, &pair.sat, i64::from(left), 0);
            image::imageops::replace(&mut sheet, &pair.uav, i64::from(left), i64::from(side));
            for (k, (a, b)) in pair
                .sat_points
                .iter()
                .zip(&pair.uav_points)
                .take(12)
                .enumerate()
            {
                let colour = Rgb([
                    (k * 61 % 256) as u8,
                    (k * 97 % 256) as u8,
                    255 - (k * 20) as u8,
                ]);
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let put = |sheet: &mut RgbImage, at: &[f32; 2], top: u32| {
                        let x = left + (at[0].max(0.0) as u32 + dx).min(side - 1);
                        let y = top + (at[1].max(0.0) as u32 + dy).min(side - 1);
                        sheet.put_pixel(x, y, colour);
                    };
                    put(&mut sheet, a, 0);
                    put(&mut sheet, b, side);
                }
            }
        }
        sheet.save(Path::new(out).join(format!("batch{step}.png")))?;
    }
    Ok(())
}
