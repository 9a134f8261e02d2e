//! Makes a model file of a run's checkpoint: `export CONFIG.toml OUT.safetensors`.

#![allow(clippy::print_stdout)]

use burn::tensor::Device;
use grimnet_train::{
    Checkpoint, ExportOptions, TrainConfig, checkpoint_path, export, save_model, sources_of,
};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    tracing_subscriber::fmt::init();
    let arguments: Vec<String> = std::env::args().collect();
    let [_, config, out] = &arguments[..] else {
        return Err("usage: export CONFIG.toml OUT.safetensors".into());
    };
    let config = TrainConfig::open(Path::new(config))?;
    let device = Device::flex();
    let (sources, pictures) = sources_of(&config)?;
    let checkpoint = Checkpoint::open(&checkpoint_path(&config), &device)?;
    let exported = export(
        &checkpoint,
        &config,
        &sources,
        &pictures,
        &ExportOptions::default(),
        &device,
    )?;
    for (kind, v) in &exported.tried {
        println!("whitening {kind:?}: {v:?}");
    }
    save_model(&exported.model, Path::new(out))?;
    println!("{}\n{}", exported.model.hash(), exported.model.card().notes);
    Ok(())
}
