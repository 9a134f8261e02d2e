//! A training run: progress bar, curves, Ctrl-C, and export at the end.

use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};
use grimnet_answer::printable;
use grimnet_train::{
    Checkpoint, Curves, Data, Device, MODEL, Progress, RunFolder, Stage, TrainConfig, Trainer,
    checkpoint_path, export, last_checkpoint,
};

use super::arguments::TrainArgs;
use super::share_bar::share_bar;
use super::validation_log::ValidationLog;
use crate::exit::Exit;
use crate::interrupt;
use crate::standard_output::StandardOutput;

/// Trains, or exports the model of the last checkpoint.
///
/// # Errors
/// Returns an error if the data, the checkpoint or the initial weights cannot be used, or a loss is not finite.
pub(super) fn run(path: &Path, config: &TrainConfig, arguments: &TrainArgs) -> Result<Exit> {
    if arguments.export && config.stage != Stage::Joint {
        bail!(
            "the stage `{}` makes no model; give its checkpoint, {}, to the next stage",
            config.stage,
            printable(&checkpoint_path(config).display().to_string())
        );
    }
    // What cannot be written is refused at once, not after the data were read.
    let policy = arguments.overwrite.policy().protect(path);
    let folder = RunFolder::open(config, &policy)?;
    let is_new = !arguments.resume && !arguments.export;
    if is_new && !arguments.overwrite.overwrite {
        folder.check_for_new_run()?;
    }
    let data = Data::open(config)?;
    if data.unreadable > 0 {
        tracing::warn!(
            "{} picture files cannot be used and are skipped",
            data.unreadable
        );
    }
    let device = config.device.device()?;
    if arguments.export {
        let state = last_checkpoint(config, &data.training, &device)?;
        return finish(&state, config, &data, &device, &folder);
    }
    let mut trainer = Trainer::new(
        config.clone(),
        data.training.clone(),
        &device,
        arguments.resume,
    )?
    .with_folder(folder.clone());
    let stopped = trainer.stop_switch();
    interrupt::stop_on_interrupt(&stopped)?;
    train(&mut trainer, config, &data, &folder, &stopped)?;
    if stopped.load(Ordering::Relaxed) {
        let mut out = std::io::stderr().lock();
        writeln!(
            out,
            "stopped at step {}; resume with: grim train {} --resume",
            trainer.state().position.step,
            printable(&path.display().to_string())
        )?;
        return Ok(Exit::Interrupted);
    }
    // The checkpoint has it all, so that the first Ctrl-C of the export ends the program as a second one does.
    stopped.store(true, Ordering::Relaxed);
    finish(trainer.state(), config, &data, &device, &folder)
}

fn train(
    trainer: &mut Trainer,
    config: &TrainConfig,
    data: &Data,
    folder: &RunFolder,
    stopped: &AtomicBool,
) -> Result<()> {
    let mut curves = Curves::open(folder, trainer.state().position.step)?;
    let mut validation = ValidationLog::open(config, data, folder, trainer.state())?;
    let bar = share_bar()?;
    let mut failed = None;
    trainer.run(&mut |progress, state| {
        let whole_s = progress.elapsed_s + progress.remaining_s;
        bar.set_position((1000.0 * progress.elapsed_s / whole_s) as u64);
        bar.set_message(line(progress));
        if bar.is_hidden() {
            tracing::info!("{}", line(progress));
        }
        let noted = curves.add(progress).map_err(Into::into);
        failed = noted
            .and_then(|()| validation.add_if_due(state, &bar))
            .err();
        failed.is_none()
    })?;
    // Who stops a run does not wait for figures; the next one measures again.
    if failed.is_none() && !stopped.load(Ordering::Relaxed) {
        validation.add_at_end(trainer.state(), &bar)?;
    }
    bar.finish_and_clear();
    failed.map_or(Ok(()), Err)
}

/// A report as one line.
fn line(p: &Progress) -> String {
    let losses: Vec<String> = p
        .losses
        .terms()
        .iter()
        .filter_map(|(name, value)| Some(format!("{name} {:.3}", (*value)?)))
        .collect();
    format!(
        "step {}, {}, {:.1} pairs/s, {:.0} min left",
        p.step,
        losses.join(", "),
        p.pairs_per_s,
        p.remaining_s / 60.0
    )
}

/// Exports the model and prints its figures. The stages before `joint` make no model: the next stage reads their checkpoint.
fn finish(
    state: &Checkpoint,
    config: &TrainConfig,
    data: &Data,
    device: &Device,
    folder: &RunFolder,
) -> Result<Exit> {
    if config.stage != Stage::Joint {
        let mut out = StandardOutput;
        let path = checkpoint_path(config).display().to_string();
        writeln!(out, "{}", printable(&path))?;
        return Ok(Exit::Done);
    }
    let bar = share_bar()?;
    bar.set_message("model");
    let exported = export(state, config, data, device, &mut |share| {
        bar.set_position((share * 1000.0) as u64);
    })?;
    bar.finish_and_clear();
    folder.write_model(&exported.model)?;
    report(&exported.model, &config.out.join(MODEL))?;
    Ok(Exit::Done)
}

fn report(model: &grimnet_net::Model, path: &Path) -> Result<()> {
    let mut out = StandardOutput;
    writeln!(out, "{}", printable(&path.display().to_string()))?;
    writeln!(out, "  hash {}", model.hash())?;
    writeln!(out, "  {}", model.card().notes)?;
    Ok(())
}
