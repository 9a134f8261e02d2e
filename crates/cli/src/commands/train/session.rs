//! One training run: bar, curves, Ctrl-C, and the model file at its end.

use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::Ordering;

use anyhow::{Context as _, Result};
use grimnet_train::data::Data;
use grimnet_train::{
    Checkpoint, Curves, Device, Progress, Stage, TrainConfig, Trainer, Validator, checkpoint_path,
    export, save_model,
};
use indicatif::{ProgressBar, ProgressStyle};

use super::flight_log::FlightLog;
use super::{TrainArgs, labels};
use crate::exit::Exit;
use crate::interrupt;

/// Runs the command.
///
/// # Errors
/// A configuration, data or a checkpoint that cannot be used; a loss that is not a number.
pub fn run(arguments: &TrainArgs) -> Result<Exit> {
    let path = arguments.config.as_deref().context(
        "name a configuration, as in: grim train training.toml (TRAINING.md shows what to write in it)",
    )?;
    let config = TrainConfig::open(path)?;
    if arguments.labels {
        return labels::run(path, &config);
    }
    let data = Data::open(&config)?;
    if data.unreadable > 0 {
        tracing::warn!(
            "{} files are no usable pictures and were left out",
            data.unreadable
        );
    }
    let device = config.device.device()?;
    if arguments.export {
        let state = Checkpoint::open(&checkpoint_path(&config), &device)?;
        return finish(&state, &config, &data, &device);
    }
    let mut trainer = Trainer::new(
        config.clone(),
        data.training.clone(),
        &device,
        arguments.resume,
    )?;
    let stopped = trainer.stop_switch();
    interrupt::stop_on_interrupt(&stopped)?;
    train(&mut trainer, &config, &data)?;
    if stopped.load(Ordering::Relaxed) {
        let mut out = std::io::stderr().lock();
        writeln!(
            out,
            "stopped at step {}; go on with: grim train {} --resume",
            trainer.state().position.step,
            path.display()
        )?;
        return Ok(Exit::Done);
    }
    finish(trainer.state(), &config, &data, &device)
}

fn train(trainer: &mut Trainer, config: &TrainConfig, data: &Data) -> Result<()> {
    let mut curves = Curves::open(&config.out, trainer.state().position.step)?;
    let mut validator = Validator::new(config, data);
    let mut flight = FlightLog::of(config);
    let bar = share_bar()?;
    let mut failed = None;
    trainer.run(&mut |progress, state| {
        let whole_s = progress.elapsed_s + progress.remaining_s;
        bar.set_position((1000.0 * progress.elapsed_s / whole_s) as u64);
        bar.set_message(line(progress));
        if bar.is_hidden() {
            tracing::info!("{}", line(progress));
        }
        let noted = curves
            .add(progress)
            .and_then(|()| validator.measure_if_due(state));
        match noted {
            Ok(Some(measured)) => {
                for (name, v) in measured {
                    bar.suspend(|| tracing::info!("{name}: {v}"));
                }
                if let Some(Err(error)) = flight.as_mut().map(|flight| flight.add(state)) {
                    failed = Some(error);
                }
            }
            Ok(None) => {}
            Err(error) => failed = Some(error.into()),
        }
        failed.is_none()
    })?;
    bar.finish_and_clear();
    failed.map_or(Ok(()), Err)
}

/// A bar over the run, in thousandths.
pub(super) fn share_bar() -> Result<ProgressBar> {
    let bar = ProgressBar::new(1000);
    bar.set_style(
        ProgressStyle::with_template("{wide_bar} {percent:>3} % {msg}")?.progress_chars("━╸ "),
    );
    Ok(bar)
}

/// One report in words.
fn line(p: &Progress) -> String {
    let losses: Vec<String> = p
        .losses
        .terms()
        .iter()
        .filter(|(_, value)| *value != 0.0)
        .map(|(name, value)| format!("{name} {value:.3}"))
        .collect();
    format!(
        "step {}, {}, {:.1} pairs/s, {:.0} min left",
        p.step,
        losses.join(", "),
        p.pairs_per_s,
        p.remaining_s / 60.0
    )
}

/// Makes the model file and says what it is worth. The earlier stages make none: the next one reads their checkpoint.
fn finish(state: &Checkpoint, config: &TrainConfig, data: &Data, device: &Device) -> Result<Exit> {
    if config.stage != Stage::Joint {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}", checkpoint_path(config).display())?;
        return Ok(Exit::Done);
    }
    let bar = share_bar()?;
    bar.set_message("model");
    let exported = export(state, config, data, device, &mut |share| {
        bar.set_position((share * 1000.0) as u64);
    })?;
    bar.finish_and_clear();
    let path = config.out.join("model.safetensors");
    save_model(&exported.model, &path)?;
    report(&exported.model, &path)?;
    Ok(Exit::Done)
}

fn report(model: &grimnet_net::Model, path: &Path) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{}", path.display())?;
    writeln!(out, "  hash {}", model.hash())?;
    writeln!(out, "  {}", model.card().notes)?;
    Ok(())
}
