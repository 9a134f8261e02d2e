//! Options of `grim eval` about retrieval: the resolution that is searched, and when a tile is right.

use clap::Args;
use grimnet_eval::metrics::recall::PAPER_RADIUS_PX;
use grimnet_pack::Levels;

use super::elsewhere::ELSEWHERE_FOLDERS;
use crate::values;

/// Heading of these options in the help.
const RETRIEVAL: &str = "Retrieval";

/// The tiles that are searched, and when a retrieved tile is right.
#[derive(Debug, Clone, Args)]
pub struct RetrievalOptions {
    /// Build only this ground resolution of the map, metres per pixel
    #[arg(long, value_name = "M", value_parser = values::gsd_m, allow_hyphen_values = true, help_heading = RETRIEVAL)]
    pub gsd: Option<f64>,

    /// Radius of the second definition of a right tile: its centre within this many pixels of the true position
    #[arg(
        long,
        value_name = "PX",
        default_value_t = PAPER_RADIUS_PX,
        value_parser = values::length_px,
        allow_hyphen_values = true,
        conflicts_with_all = [ELSEWHERE_FOLDERS, "track"],
        help_heading = RETRIEVAL
    )]
    pub recall_radius: f64,
}

impl RetrievalOptions {
    /// The levels to build.
    pub fn levels(&self) -> Levels {
        self.gsd
            .map_or(Levels::Auto, |gsd_m| Levels::Gsd(vec![gsd_m]))
    }
}
