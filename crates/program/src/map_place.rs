//! Which map, and where it lies.

use std::path::Path;
use std::str::FromStr;

use anyhow::{Result, bail};
use clap::Args;
use grimnet_geo::{MapOptions, Raster, open_map};
use grimnet_output::OutputPolicy;
use grimnet_pack::{Pack, manifest::MapSummary};

use crate::inputs;

/// Heading of the options that say where a map lies.
const MAP: &str = "Map without georeference";

/// Heading of the options for maps of tiles.
const TILES: &str = "Map of tiles";

/// Where a map lies, if its file does not state it.
#[derive(Debug, Clone, Default, Args)]
pub struct MapPlace {
    /// Coordinate system of a map that does not state it, or states a wrong one, such as EPSG:25833
    #[arg(long, value_name = "CRS", help_heading = MAP)]
    pub crs: Option<String>,

    /// Corners of a picture without georeference, degrees: lower left, then upper right
    #[arg(
        long,
        value_name = "LL_LON,LL_LAT,UR_LON,UR_LAT",
        allow_hyphen_values = true,
        help_heading = MAP
    )]
    pub corners: Option<CornersChoice>,

    /// Zoom of a map of tiles (MBTiles, PMTiles, a folder) [default: the finest]
    #[arg(long, value_name = "Z", help_heading = TILES)]
    pub zoom: Option<u8>,
}

/// `LL_LON,LL_LAT,UR_LON,UR_LAT`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornersChoice([f64; 4]);

impl FromStr for CornersChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
        numbers
            .ok()
            .and_then(|n| n.try_into().ok())
            .map(Self)
            .ok_or_else(|| {
                "expected longitude and latitude of the lower left, then of the upper right corner, degrees, such as \
                 13.40,52.50,13.42,52.52"
                    .to_owned()
            })
    }
}

impl MapPlace {
    /// Whether any of these options was given.
    #[must_use]
    pub fn is_given(&self) -> bool {
        self.crs.is_some() || self.corners.is_some() || self.zoom.is_some()
    }

    /// Checks that these options have an effect, in a command that reads a pack and, with --map, the map that it was built from.
    ///
    /// # Errors
    /// One was given without a map.
    pub fn check_is_used(&self, has_map: bool) -> Result<()> {
        if self.is_given() && !has_map {
            bail!(
                "--crs, --corners and --zoom say where the map of --map lies: a pack already knows it"
            );
        }
        Ok(())
    }

    /// The options of the map reader.
    pub fn options(&self) -> MapOptions {
        MapOptions {
            crs: self.crs.clone(),
            corners: self.corners.map(|c| c.0),
            zoom: self.zoom,
            ..MapOptions::default()
        }
    }

    /// Opens a map as an input of a run: under `policy` no output replaces a file that it is read from.
    ///
    /// # Errors
    /// The map cannot be read, or has no georeference.
    pub fn open(&self, path: &Path, policy: &OutputPolicy) -> Result<Box<dyn Raster>> {
        inputs::check_map(path)?;
        policy.add_inputs([path]);
        let map = open_map(path, &self.options())?;
        policy.add_input_trees(map.files());
        Ok(map)
    }

    /// As [`MapPlace::open`], for a map that has to be the one that `pack` was built from.
    ///
    /// # Errors
    /// The map cannot be read, or is another one.
    pub fn open_of_pack(
        &self,
        path: &Path,
        policy: &OutputPolicy,
        pack: &Pack,
    ) -> Result<Box<dyn Raster>> {
        let map = self.open(path, policy)?;
        check_built_from(pack, map.as_ref(), path)?;
        Ok(map)
    }
}

/// Whether `map` is the map that the pack was built from.
///
/// # Errors
/// The map cannot be read.
pub fn is_built_from(pack: &Pack, map: &dyn Raster) -> Result<bool> {
    Ok(content_hash(map)? == pack.manifest().map.hash)
}

fn content_hash(map: &dyn Raster) -> Result<String> {
    Ok(MapSummary::hash_text(map.content_hash()?))
}

/// Checks that `map` is the map that the pack was built from: drawings take the pack's pixel positions.
///
/// # Errors
/// The map is another one or cannot be read.
pub fn check_built_from(pack: &Pack, map: &dyn Raster, path: &Path) -> Result<()> {
    let hash = content_hash(map)?;
    if hash != pack.manifest().map.hash {
        bail!(
            "{} is not the map that {} was built from, or was changed since: expected content hash {}, found {}; give that \
             map, or build the pack again",
            path.display(),
            pack.path().display(),
            short(&pack.manifest().map.hash),
            short(&hash)
        );
    }
    Ok(())
}

fn short(hash: &str) -> &str {
    hash.get(..16).unwrap_or(hash)
}
