//! `grim model`: look into a model file.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;
use clap::Subcommand;

use super::ModelChoice;
use crate::exit::Exit;

/// Look into a model file.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// What it is, what it was trained on, its licence and its hash
    Info {
        /// Model file [default: the bundled one]
        file: Option<PathBuf>,
        /// As JSON
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
    }
    .open()?;
    let values: usize = model
        .spec()
        .parameters()
        .iter()
        .map(|(_, shape)| shape.iter().product::<usize>())
        .sum();
    let mut out = std::io::stdout().lock();
    if json {
        let info = serde_json::json!({
            "hash": model.hash().to_string(),
            "values": values,
            "card": model.card(),
            "spec": model.spec(),
        });
        serde_json::to_writer_pretty(&mut out, &info)?;
        writeln!(out)?;
        return Ok(Exit::Done);
    }
    let name = file.map_or_else(
        || "the bundled model".to_owned(),
        |f| f.display().to_string(),
    );
    writeln!(out, "{name}")?;
    if model.is_random() {
        writeln!(
            out,
            "  THIS MODEL IS RANDOM NUMBERS: it finds nothing. It stands in until one is trained."
        )?;
    }
    if bundled {
        writeln!(out, "  {:<14} compiled into this program", "where")?;
    }
    writeln!(out, "  {:<14} {}", "preset", model.spec().preset)?;
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
            writeln!(out, "  {key:<14} {text}")?;
        }
    }
    Ok(Exit::Done)
}
