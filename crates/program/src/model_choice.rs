//! The options `--model` and `--precision`.

use std::path::PathBuf;

use anyhow::Result;
use grimnet_net::{Model, Precision};

use crate::inputs;

/// The model that computes features.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ModelChoice {
    /// Model file [default: the bundled one]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Precision of the network [default: mixed if network and processor have int8, else f32]
    ///
    /// int8 changes descriptors by 2 to 4 %. It takes about half the time on processors with VNNI (AVX-512 or AVX) and longer than f32 on
    /// those without; with Arm's dot product it was not timed. mixed uses int8 to search heading and ground width where both are unknown,
    /// and f32 for all else. Packs of any work with any.
    #[arg(long, value_name = "mixed|f32|int8")]
    pub precision: Option<Precision>,
}

impl ModelChoice {
    /// Opens the chosen model.
    ///
    /// # Errors
    /// The file is no model of this program, or its network cannot be computed in the chosen precision.
    pub fn open(&self) -> Result<Model> {
        let model = match &self.model {
            Some(path) => {
                inputs::check_regular(path)?;
                Model::open(path)?
            }
            None => Model::bundled()?,
        };
        Ok(model.with_precision_if_given(self.precision)?)
    }
}
