//! Builds a pack from a map: features of every cell or tile, once, offline.
//!
//! Finished work goes to a journal beside the output (`AREA.grim.partial`), so that a build that was stopped at any
//! moment continues where it was when it is started again with the same map, model and options. The pack itself is
//! assembled from the journal (`AREA.grim.assembling`) and renamed; an earlier pack stays intact until then.

pub(crate) mod adapt;
pub(crate) mod assemble;
pub(crate) mod cells;
pub(crate) mod cost;
pub(crate) mod finished_level;
pub(crate) mod frontier;
pub(crate) mod index_build;
pub(crate) mod keypoint_index_build;
pub(crate) mod level_build;
pub(crate) mod level_plan;
pub(crate) mod level_state;
pub(crate) mod planning;
pub(crate) mod progress;
pub(crate) mod recipe;
pub(crate) mod record;
pub(crate) mod resolutions;
pub(crate) mod resume;
pub(crate) mod summary;
pub(crate) mod tile_descriptors;
pub(crate) mod unit;
pub(crate) mod usable;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use grimnet_geo::Raster;
use grimnet_net::{Model, NetSpec};
use grimnet_output::{Journal, OutputPolicy, Snapshot, linked_path, rename_into_place};

use self::assemble::write_pack;
use self::cells::Cells;
use self::cost::{check_cost, check_enlargement, check_index, check_scale};
use self::finished_level::FinishedLevel;
use self::level_build::LevelBuild;
use self::level_plan::LevelPlan;
use self::planning::plan_levels;
use self::progress::{BuildReport, Meter, Phase, Progress};
use self::recipe::Recipe;
use self::resume::Resume;
use self::summary::new_manifest;
use crate::error::{PackError, Result};
use crate::manifest::{LevelManifest, Manifest, MapSummary};
use crate::mode::Mode;
use crate::options::BuildOptions;
use crate::pack::Pack;
use crate::paper::{PaperTiles, corner_error_m};
use crate::writer::{Writer, clear_unfinished};
use grimnet_limits::BuildLimits;

/// Builds the pack `out` of a map, or continues an interrupted build. `on_progress` is called after each piece of work.
///
/// The bytes of the result depend on map, model, options and instruction set only: not on the number of threads, nor
/// on interruptions. Memory does not grow with the map except for a few bytes per tile.
///
/// # Errors
/// Returns an error if the options are invalid, the map cannot be read or has no usable tile, the plan exceeds a limit
/// of [`BuildLimits`], another process builds the same pack, what stands at `out` is created or changed meanwhile, the disk
/// is full, or the folder cannot be written. What was computed is kept for the next run where that is possible.
pub fn build(
    raster: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    out: &Path,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<BuildReport> {
    build_with_limits(
        raster,
        model,
        options,
        &BuildLimits::default(),
        out,
        on_progress,
    )
}

/// [`build`] with other limits than the default ones.
///
/// # Errors
/// As [`build`].
pub fn build_with_limits(
    raster: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    limits: &BuildLimits,
    out: &Path,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<BuildReport> {
    build_interruptible(raster, model, options, limits, out, &mut |progress| {
        on_progress(progress);
        ControlFlow::Continue(())
    })
}

/// [`build_with_limits`], which ends when `on_progress` returns [`ControlFlow::Break`]. The next build with the same arguments
/// continues it.
///
/// # Errors
/// As [`build`]; [`PackError::Stopped`] if `on_progress` ended it.
pub fn build_interruptible(
    raster: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    limits: &BuildLimits,
    out: &Path,
    on_progress: &mut dyn FnMut(&Progress) -> ControlFlow<()>,
) -> Result<BuildReport> {
    // Behind a link: the working files have to be on the disk of the pack.
    let place = linked_path(out)?;
    let mut notify = |progress: &Progress| match on_progress(progress) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(PackError::Stopped {
            path: place.clone(),
        }),
    };
    let [partial, aside] = working_files(&place);
    let before = Snapshot::of(&place).map_err(|e| PackError::io("examine", &place, e))?;
    check_outputs(raster, out, [&partial, &aside])?;
    let recipe = recipe_of(options);
    let recipe = recipe.as_ref();
    let plans = checked_plans(raster, model.spec(), options, recipe, limits)?;
    if options.mode == Mode::Paper {
        warn_of_another_network(model);
        warn_of_linear_coordinates(raster);
    }
    let manifest = new_manifest(raster, model, options)?;
    let mut meter = Meter::new(plans.iter().map(LevelPlan::grid_tiles).sum());
    if let Some(pack) = finished(out, &manifest.fingerprint) {
        Journal::remove_finished(&partial, &manifest.fingerprint);
        return Ok(report(&pack, &meter, true));
    }
    let mut resume = Resume::new(&plans, recipe);
    let mut journal = Journal::open(
        &partial,
        out,
        &manifest.fingerprint,
        |kind, place, content| resume.accept(kind, place, content),
    )
    .map_err(PackError::of_journal)?;
    clear_unfinished(&aside)?;
    let mut states = resume.into_levels();
    let mut levels = Vec::new();
    for (number, plan) in plans.into_iter().enumerate() {
        meter.progress.level = number;
        meter.progress.gsd_m = plan.frame.gsd_m;
        let state = states.pop_front().unwrap_or_default();
        let level = LevelBuild {
            raster,
            model,
            options,
            recipe,
            plan,
            number: number as u32,
        };
        levels.push(level.run(state, &mut journal, &mut meter, &mut notify)?);
    }
    if levels.iter().all(|level| level.tiles.is_empty()) {
        journal.remove().map_err(PackError::of_journal)?;
        return Err(without_tiles(raster, &meter.progress));
    }
    if MapSummary::hash_text(raster.content_hash_now()?) != manifest.map.hash {
        // Its tiles are of the map before, or of something in between.
        journal.remove().map_err(PackError::of_journal)?;
        return Err(PackError::MapChanged {
            map: raster.describe(),
        });
    }
    meter.progress.phase = Phase::Writing;
    notify(&meter.progress)?;
    write_aside(&aside, &mut journal, levels, manifest, recipe)?;
    rename_into_place(&aside, &place, &before).inspect_err(|_| {
        // As after a failed write: the journal stays.
        let _ = fs_err::remove_file(&aside);
    })?;
    // While the work can still be used: a pack that cannot be opened is none.
    let pack = Pack::open(out)?;
    journal.remove().map_err(PackError::of_journal)?;
    Ok(report(&pack, &meter, false))
}

/// The levels of a build, and all that is refused before work starts.
///
/// # Errors
/// Returns an error if the map's pixels have an implausible size, the options do not fit, or the plan exceeds a limit.
pub(crate) fn checked_plans(
    raster: &dyn Raster,
    spec: &NetSpec,
    options: &BuildOptions,
    recipe: &dyn Recipe,
    limits: &BuildLimits,
) -> Result<Vec<LevelPlan>> {
    check_scale(raster, limits)?;
    let plans = plan_levels(
        raster.georeference(),
        raster.size_px(),
        options,
        recipe,
        spec,
    )?;
    check_cost(&plans, spec, options, recipe, limits)?;
    check_index(&plans, spec, options)?;
    check_enlargement(&plans, raster, options)?;
    Ok(plans)
}

/// Writes the pack to `aside`.
///
/// # Errors
/// As [`write_pack`]. The file is then removed.
fn write_aside(
    aside: &Path,
    journal: &mut Journal,
    levels: Vec<FinishedLevel>,
    manifest: Manifest,
    recipe: &dyn Recipe,
) -> Result<()> {
    let writer = Writer::create_new(aside)?;
    write_pack(writer, journal, levels, manifest, recipe).inspect_err(|_| {
        // The journal stays; half a pack would only fill the disk.
        let _ = fs_err::remove_file(aside);
    })
}

/// The error for a map of which no tile is usable.
fn without_tiles(raster: &dyn Raster, progress: &Progress) -> PackError {
    PackError::Empty {
        map: raster.describe(),
        why: format!(
            "all {} tiles are without data or black; check that the map is not blank, and that its coordinate system and \
             scale are right",
            progress.tiles_skipped
        ),
    }
}

/// Refuses an output that is a folder or device, and one that would replace the map, before hours of work.
fn check_outputs(raster: &dyn Raster, out: &Path, working_files: [&Path; 2]) -> Result<()> {
    if std::fs::metadata(out).is_ok_and(|metadata| !metadata.is_file()) {
        return Err(PackError::NotAFile {
            path: out.to_path_buf(),
        });
    }
    let inputs = OutputPolicy::new().protect_trees(raster.files());
    for path in [out].into_iter().chain(working_files) {
        inputs.check_not_input(path)?;
    }
    Ok(())
}

/// Warns if the model's network is not the paper's as published: what is measured is then the paper's procedure with it.
fn warn_of_another_network(model: &Model) {
    let differences = model.spec().differences_from_paper();
    if !differences.is_empty() {
        tracing::warn!(
            "paper mode with the network `{}`, which is not the paper's (`vgg16-paper`): {}; this is the paper's procedure with another network",
            model.spec().preset,
            differences.join("; ")
        );
    }
}

/// Error of the paper's coordinates above which a build says so, metres.
const NOTABLE_CORNER_ERROR_M: f64 = 1.0;

/// Warns if the paper's coordinates, linear between two corners of the map, place other parts of it elsewhere.
fn warn_of_linear_coordinates(raster: &dyn Raster) {
    match corner_error_m(raster.georeference(), raster.size_px()) {
        Ok(error_m) if error_m > NOTABLE_CORNER_ERROR_M => tracing::warn!(
            "paper mode's coordinates are linear between the map's lower left and upper right corners, which is wrong by up to \
             {error_m:.0} m on this map; a map in EPSG:4326 or EPSG:3857 that is not very large has no such error"
        ),
        _ => {}
    }
}

/// What the options' mode does differently.
pub(crate) fn recipe_of(options: &BuildOptions) -> Box<dyn Recipe> {
    match options.mode {
        Mode::Default => Box::new(Cells),
        Mode::Paper => Box::new(PaperTiles {
            resolution_px: options.resolution,
        }),
    }
}

/// The pack at `out`, if it is undamaged and was built from the same inputs.
fn finished(out: &Path, fingerprint: &str) -> Option<Pack> {
    out.try_exists().ok().filter(|&exists| exists)?;
    let opened = Pack::open(out).and_then(|pack| {
        let is_same = pack.manifest().fingerprint == fingerprint;
        if is_same {
            // Opening leaves out the features of a large pack, and who is told to build a damaged one again must get a new one.
            pack.verify(&mut |_| ())?;
        }
        Ok(is_same.then_some(pack))
    });
    match opened {
        Ok(same) => same,
        Err(error) => {
            tracing::warn!(%error, "the existing output is not a usable pack; it will be replaced");
            None
        }
    }
}

fn report(pack: &Pack, meter: &Meter, was_complete: bool) -> BuildReport {
    let sum = |of: fn(&LevelManifest) -> u64| pack.manifest().levels.iter().map(of).sum();
    BuildReport {
        path: pack.path().to_path_buf(),
        len_bytes: pack.len_bytes(),
        tiles: sum(|level| level.tiles),
        tiles_skipped: sum(|level| level.tiles_skipped),
        tiles_resumed: meter.progress.tiles_resumed,
        was_complete,
        duration: meter.elapsed(),
    }
}

/// The files that a build of `AREA.grim` keeps beside it: its finished work, `AREA.grim.partial`, and the pack that is being
/// assembled, `AREA.grim.assembling`. Of a link they lie beside what it leads to.
pub fn working_files(out: &Path) -> [PathBuf; 2] {
    ["partial", "assembling"].map(|ending| {
        let mut name = out.as_os_str().to_owned();
        name.push(".");
        name.push(ending);
        PathBuf::from(name)
    })
}
