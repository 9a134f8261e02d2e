//! The commands, one file each.

#[cfg(not(all(feature = "serve", feature = "train")))]
mod absent;
pub mod calibrate;
pub mod completions;
pub mod data_set_map;
pub mod demo;
pub mod demo_flight;
pub mod elsewhere;
pub mod eval;
pub mod eval_pictures;
pub mod eval_run;
mod eval_track_flights;
mod eval_track_hidden;
mod eval_track_options;
pub mod link;
pub mod link_check;
pub mod link_options;
pub mod locate;
pub mod locate_options;
pub mod man;
pub mod map;
pub mod map_build;
pub mod map_check;
pub mod map_info;
pub mod map_picture;
pub mod map_sample;
pub mod model;
pub mod results;
pub mod retrieval_options;
pub mod serve;
pub mod track;
pub mod track_link;
pub mod track_options;
pub mod track_output;
pub mod track_reader;
pub mod track_replay;
pub mod track_report;
#[cfg(feature = "serve")]
pub mod track_session;
pub mod track_source;
pub mod train;

use grimnet_pack::BuildOptions;
pub use grimnet_program::limits_choice::LimitsChoice;
pub use grimnet_program::map_place;
pub use grimnet_program::model_choice::ModelChoice;

/// The two named methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum ModeChoice {
    /// The most accurate and fastest method of this program
    #[default]
    Default,
    /// The paper's procedure (see EVALUATION.md): independent tiles, 320 x 320, IVF-PQ, top 5, always an answer
    Paper,
}

impl ModeChoice {
    /// What a pack for this method is built with.
    fn build_options(self) -> BuildOptions {
        match self {
            Self::Default => BuildOptions::standard(),
            Self::Paper => BuildOptions::paper(),
        }
    }
}
