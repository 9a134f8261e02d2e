//! Options of `grim eval` about retrieval: resolution, foreign tiles, and when a tile is right.

use std::path::{Path, PathBuf};

#[cfg(feature = "experiments")]
use anyhow::Context;
use anyhow::Result;
use clap::Args;
use grimnet_eval::metrics::recall::PAPER_RADIUS_PX;
#[cfg(feature = "experiments")]
use grimnet_experiments::gallery::{Gallery, open_foreign};
use grimnet_geo::Raster;
use grimnet_pack::Levels;

use crate::values;

/// Heading of these options in the help.
const RETRIEVAL: &str = "Retrieval";

/// The tiles that are searched, and when a retrieved tile is right.
#[derive(Debug, Clone, Args)]
pub struct GalleryOptions {
    /// Add the tiles of this foreign map, or of all pictures in this folder, to the gallery
    #[arg(
        long,
        value_name = "MAP|FOLDER",
        requires = "gsd",
        help_heading = RETRIEVAL,
        hide = cfg!(not(feature = "experiments"))
    )]
    pub distractors: Option<PathBuf>,

    /// Build only this ground resolution of the map, metres per pixel; foreign pictures without a georeference are assumed to have it
    #[arg(long, value_name = "M", value_parser = values::gsd_m, allow_hyphen_values = true, help_heading = RETRIEVAL)]
    pub gsd: Option<f64>,

    /// Radius of the second definition of a right tile: its centre within this many pixels of the true position
    #[arg(
        long,
        value_name = "PX",
        default_value_t = PAPER_RADIUS_PX,
        value_parser = values::length_px,
        allow_hyphen_values = true,
        help_heading = RETRIEVAL
    )]
    pub recall_radius: f64,
}

impl GalleryOptions {
    /// The map as it is, or with the foreign tiles beside it.
    ///
    /// # Errors
    /// Foreign pictures cannot be read.
    pub fn lay_out(&self, map: Box<dyn Raster>) -> Result<Box<dyn Raster>> {
        let (Some(path), Some(gsd_m)) = (&self.distractors, self.gsd) else {
            return Ok(map);
        };
        lay_beside(map, path, gsd_m)
    }

    /// The levels to build.
    pub fn levels(&self) -> Levels {
        self.gsd
            .map_or(Levels::Auto, |gsd_m| Levels::Gsd(vec![gsd_m]))
    }
}

/// The map with the foreign tiles of `path` beside it.
#[cfg(feature = "experiments")]
fn lay_beside(map: Box<dyn Raster>, path: &Path, gsd_m: f64) -> Result<Box<dyn Raster>> {
    let foreign = open_foreign(path, gsd_m)?;
    let gallery = Gallery::new(map, foreign, gsd_m, path)
        .with_context(|| format!("cannot add the distractors of {}", path.display()))?;
    tracing::info!("{}", gallery.describe());
    Ok(Box::new(gallery))
}

#[cfg(not(feature = "experiments"))]
fn lay_beside(_: Box<dyn Raster>, _: &Path, _: f64) -> Result<Box<dyn Raster>> {
    anyhow::bail!(super::absent::message("--distractors", "experiments"))
}
