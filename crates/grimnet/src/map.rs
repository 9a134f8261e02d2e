//! Building a pack from a map.

use std::ops::ControlFlow;
use std::path::Path;

pub use grimnet_geo::{GeoError, MapOptions};
pub use grimnet_output::OutputError;
pub use grimnet_pack::{BuildLimits, BuildOptions, BuildReport, Levels, Phase, Progress};

use grimnet_geo::open_map;
use grimnet_net::{Model, NetError};
use grimnet_output::OutputPolicy;
use grimnet_pack::{PackError, format::MAGIC};

/// Where the map is and how its pack is built.
#[derive(Debug, Clone, Default)]
pub struct MapBuild {
    /// The georeference of the map if its file has none or a wrong one.
    pub map: MapOptions,
    /// Contents of the pack.
    pub pack: BuildOptions,
    /// What a build may cost, and what a map may be.
    pub limits: BuildLimits,
    /// The network; `None` for the bundled model. Photos must be localised with the same model.
    pub model: Option<Model>,
    /// Whether a file at the pack's path may be replaced that is neither a pack nor named, as it is, in the list `.grim-output` of its
    /// folder. The map never is.
    pub overwrite: bool,
}

/// Why a pack could not be built.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The map cannot be read, or has no usable georeference.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// The pack cannot be built or written.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The model cannot be used.
    #[error(transparent)]
    Model(#[from] NetError),
    /// What is at the pack's path may not be replaced, or nothing can be written there.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Builds the pack `pack` from the map `map`: a GeoTIFF or COG, a picture with a world file or with corners, a VRT, a list or folder of
/// GeoTIFFs, a CSV of pictures, PMTiles, a folder of tiles `z/x/y`, or MBTiles with the feature `mbtiles`.
///
/// `on_progress` is called after each piece of work. A build that was interrupted continues when it is called again with the same
/// arguments; a complete pack of the same map, model and options is kept as it is. Another pack at that path is replaced, and an
/// unchanged file that `.grim-output` names as written by the program `grim`; any other file only with [`MapBuild::overwrite`].
///
/// # Errors
/// Returns an error if the map cannot be read or has no usable georeference, an option is invalid, or the pack cannot be written or would
/// replace a file that it may not.
///
/// # Example
/// ```no_run
/// use grimnet::map::{self, MapBuild};
///
/// let report = map::build("map.tif", "area.grim", &MapBuild::default(), |progress| {
///     eprintln!("{} of {} tiles", progress.tiles_done, progress.tiles_total);
/// })?;
/// println!("{} tiles", report.tiles);
/// # Ok::<(), map::BuildError>(())
/// ```
pub fn build(
    map: impl AsRef<Path>,
    pack: impl AsRef<Path>,
    options: &MapBuild,
    mut on_progress: impl FnMut(&Progress),
) -> Result<BuildReport, BuildError> {
    build_interruptible(map, pack, options, |progress| {
        on_progress(progress);
        ControlFlow::Continue(())
    })
}

/// As [`build`], and ends with [`PackError::Stopped`] in [`BuildError::Pack`] when `on_progress` returns [`ControlFlow::Break`]. The
/// next build with the same arguments continues it.
///
/// # Errors
/// As [`build`].
pub fn build_interruptible(
    map: impl AsRef<Path>,
    pack: impl AsRef<Path>,
    options: &MapBuild,
    mut on_progress: impl FnMut(&Progress) -> ControlFlow<()>,
) -> Result<BuildReport, BuildError> {
    OutputPolicy::new()
        .overwrite(options.overwrite)
        .protect(&map)
        .check_file(&pack, &[&MAGIC])?;
    let raster = open_map(map.as_ref(), &options.map)?;
    let bundled;
    let model = match &options.model {
        Some(model) => model,
        None => {
            bundled = Model::bundled()?;
            &bundled
        }
    };
    Ok(grimnet_pack::build_interruptible(
        raster.as_ref(),
        model,
        &options.pack,
        &options.limits,
        pack.as_ref(),
        &mut on_progress,
    )?)
}
