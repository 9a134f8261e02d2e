//! The option `--model`.

use std::path::PathBuf;

use anyhow::Result;
use grimnet_net::Model;

use crate::inputs;

/// The model that computes features.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ModelChoice {
    /// Model file [default: the bundled one]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
}

impl ModelChoice {
    /// Opens the chosen model.
    ///
    /// # Errors
    /// The file is no model of this program.
    pub fn open(&self) -> Result<Model> {
        Ok(match &self.model {
            Some(path) => {
                inputs::check_regular(path)?;
                Model::open(path)?
            }
            None => Model::bundled()?,
        })
    }
}
