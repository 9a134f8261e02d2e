//! The commands, one file each.

pub mod absent;
#[cfg(feature = "experiments")]
pub mod calibrate;
pub mod completions;
pub mod demo;
pub mod demo_flight;
pub mod elsewhere;
pub mod eval;
pub mod eval_pictures;
pub mod eval_run;
mod eval_track;
#[cfg(feature = "experiments")]
pub mod experiment;
pub mod experiment_options;
pub mod gallery;
pub mod limits_choice;
pub mod link;
pub mod link_check;
pub mod link_options;
pub mod locate;
pub mod locate_options;
pub mod man;
pub mod map;
pub mod map_build;
pub mod map_info;
pub mod map_place;
pub mod model;
pub mod results;
pub mod serve;
pub mod track;
pub mod track_link;
pub mod track_options;
pub mod track_report;
pub mod train;

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

/// The two named methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum ModeChoice {
    /// The most accurate and fastest method of this program
    #[default]
    Default,
    /// The paper's procedure (see EVALUATION.md): independent tiles, 320 x 320, IVF-PQ, top 5, always an answer
    Paper,
}
