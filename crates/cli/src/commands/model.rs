//! `grim model`: what a model file holds.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;
use clap::Subcommand;
use grimnet_net::Calibration;

use super::ModelChoice;
use crate::exit::Exit;
use crate::standard_output::StandardOutput;
use grimnet_answer::printable;

const EXAMPLES: &str = "\
Examples:
  grim model info                      # the bundled model
  grim model info mine.safetensors";

/// Show what a model file holds.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// Show architecture, training data, calibration data, licence and hash
    #[command(after_help = EXAMPLES)]
    Info {
        /// Model file [default: the bundled one]
        file: Option<PathBuf>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

/// Runs the command.
///
/// # Errors
/// The file is no model of this program.
pub fn run(command: ModelCommand) -> Result<Exit> {
    let ModelCommand::Info { file, json } = command;
    let bundled = file.is_none();
    let model = ModelChoice {
        model: file.clone(),
        ..ModelChoice::default()
    }
    .open()?;
    let values: usize = model
        .spec()
        .parameters()
        .iter()
        .map(|(_, shape)| shape.iter().product::<usize>())
        .sum();
    let mut out = StandardOutput;
    if json {
        let info = serde_json::json!({
            "hash": model.hash().to_string(),
            "values": values,
            "card": model.card(),
            "spec": model.spec(),
            "differences_from_paper": model.spec().differences_from_paper(),
            "calibration": model.calibration(),
        });
        serde_json::to_writer_pretty(&mut out, &info)?;
        writeln!(out)?;
        return Ok(Exit::Done);
    }
    let name = file.map_or_else(
        || "the bundled model".to_owned(),
        |f| f.display().to_string(),
    );
    writeln!(out, "{}", printable(&name))?;
    if model.is_random() {
        writeln!(
            out,
            "  This model holds random numbers: it finds nothing. Train one first."
        )?;
    }
    if bundled {
        writeln!(out, "  {:<14} compiled into this program", "where")?;
    }
    writeln!(out, "  {:<14} {}", "preset", model.spec().preset)?;
    writeln!(
        out,
        "  {:<14} {}",
        "paper",
        match model.spec().differences_from_paper() {
            none if none.is_empty() => "the paper's network as published".to_owned(),
            differences => format!("not as published: {}", differences.join("; ")),
        }
    )?;
    writeln!(out, "  {:<14} {}", "hash", model.hash())?;
    writeln!(out, "  {:<14} {values}", "values")?;
    writeln!(
        out,
        "  {:<14} {}",
        "descriptors",
        model.spec().descriptor_dim
    )?;
    writeln!(out, "  {:<14} {}", "tile vector", model.spec().global_len())?;
    if let serde_json::Value::Object(card) = serde_json::to_value(model.card())? {
        for (key, value) in card {
            let text = value
                .as_str()
                .map_or_else(|| value.to_string(), ToOwned::to_owned);
            writeln!(out, "  {:<14} {}", printable(&key), printable(&text))?;
        }
    }
    let calibrated = calibrated_on(model.calibration());
    writeln!(out, "  {:<14} {}", "calibrated on", printable(&calibrated))?;
    Ok(Exit::Done)
}

/// The data that radius and confidence were fitted to, and the least confidence of a fix.
fn calibrated_on(calibration: &Calibration) -> String {
    let data = calibration.fitted_on.as_ref().map_or_else(
        || "nothing: the stated radius is a built-in one".to_owned(),
        |fitted| fitted.data.clone(),
    );
    match calibration.confidence {
        Some(confidence) => format!(
            "{data} (a fix needs a confidence of {:.1} %)",
            100.0 * confidence.needed
        ),
        None => format!("{data} (no confidence is stated)"),
    }
}
