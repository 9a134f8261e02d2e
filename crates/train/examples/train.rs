//! Trains from a TOML configuration: `train CONFIG.toml [--resume]`.

#![allow(clippy::print_stdout)]

use burn::tensor::Device;
use grimnet_train::{TrainConfig, Trainer, sources_of};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    tracing_subscriber::fmt::init();
    let arguments: Vec<String> = std::env::args().collect();
    let config = TrainConfig::open(Path::new(
        arguments
            .get(1)
            .ok_or("usage: train CONFIG.toml [--resume]")?,
    ))?;
    let (sources, _) = sources_of(&config)?;
    let mut trainer = Trainer::new(
        config,
        sources,
        &Device::flex(),
        arguments.iter().any(|a| a == "--resume"),
    )?;
    trainer.run(&mut |p, _| {
        let losses: Vec<String> = p
            .losses
            .terms()
            .iter()
            .filter(|(_, value)| *value != 0.0)
            .map(|(name, value)| format!("{} {value:.3}", name.trim_end_matches(" loss")))
            .collect();
        println!(
            "step {} {:.0}s {} | {:.1} pairs/s rate {:.1e} grad {:.2} left {:.0}s",
            p.step,
            p.elapsed_s,
            losses.join(", "),
            p.pairs_per_s,
            p.learning_rate,
            p.gradient,
            p.remaining_s
        );
        true
    })?;
    Ok(())
}
