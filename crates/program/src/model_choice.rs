//! The options `--model` and `--precision`.

use std::path::PathBuf;

use anyhow::Result;
use grimnet_net::{Arithmetic, Model};

use crate::inputs;

/// The model that computes features.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ModelChoice {
    /// Model file [default: the bundled one]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Arithmetic of the network: f32, or int8, which changes descriptors by 2 to 4 % and takes about half the time on processors
    /// with VNNI, no less on others. Both work with packs of either
    #[arg(long, value_name = "f32|int8", default_value_t)]
    pub precision: Arithmetic,
}

impl ModelChoice {
    /// Opens the chosen model.
    ///
    /// # Errors
    /// The file is no model of this program, or its network cannot be computed in the chosen arithmetic.
    pub fn open(&self) -> Result<Model> {
        let model = match &self.model {
            Some(path) => {
                inputs::check_regular(path)?;
                Model::open(path)?
            }
            None => Model::bundled()?,
        };
        Ok(model.with_arithmetic(self.precision)?)
    }
}
