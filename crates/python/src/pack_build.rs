//! `build_pack`.

use std::ops::ControlFlow;
use std::path::PathBuf;

use grimnet::map::{BuildOptions, Levels, MapBuild, MapOptions, Phase, build_interruptible};
use grimnet_output::OutputPolicy;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::{build_error, invalid_value, output_error, whole_number};
use crate::long_work::detached_with_threads;
use crate::model_file::open_model;

/// How far a build is.
#[pyclass(frozen, get_all, module = "grimnet")]
pub struct BuildProgress {
    /// `adapting`, `tiles` or `writing`.
    phase: &'static str,
    /// Ground resolution of the current level, metres per pixel.
    gsd_m: f64,
    /// Finished tiles of all levels.
    tiles_done: u64,
    /// Tiles of all levels.
    tiles_total: u64,
    /// Estimated seconds to the end.
    time_left_s: Option<f64>,
}

#[pymethods]
impl BuildProgress {
    fn __repr__(&self) -> String {
        format!(
            "BuildProgress({}: {} of {} tiles)",
            self.phase, self.tiles_done, self.tiles_total
        )
    }
}

/// What a build made.
#[pyclass(frozen, get_all, module = "grimnet")]
pub struct BuildReport {
    /// The pack.
    path: PathBuf,
    /// Its size, bytes.
    len_bytes: u64,
    /// Tiles with a descriptor, of all levels.
    tiles: u64,
    /// Tiles without data or black.
    tiles_skipped: u64,
    /// Tiles that an earlier, interrupted build finished.
    tiles_resumed: u64,
    /// Whether the pack was there already, complete.
    was_complete: bool,
    /// Seconds that it took.
    duration_s: f64,
}

#[pymethods]
impl BuildReport {
    fn __repr__(&self) -> String {
        format!(
            "BuildReport({:?}, {} tiles, {:.1} MB)",
            self.path,
            self.tiles,
            self.len_bytes as f64 / 1e6
        )
    }
}

/// Ground resolutions in metres per pixel, from one number or several.
///
/// # Errors
/// `InvalidValueError` for anything else, bytes among it, which are a sequence of whole numbers.
fn resolutions(given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let one = given.extract::<f64>().map(|gsd_m| vec![gsd_m]);
    match one.or_else(|_| given.extract::<Vec<f64>>()) {
        Ok(gsd_m) if !given.is_instance_of::<PyBytes>() => Ok(gsd_m),
        _ => Err(invalid_value(format!(
            "gsd_m is {}; expected metres per pixel, a number or several",
            given.repr()?
        ))),
    }
}

/// Builds the pack `out` from a map.
///
/// `gsd_m` are the ground resolutions of its levels, metres per pixel, a number or several, if not all that photos may need. `adapt`
/// recomputes the network's statistics from this map. `crs`, such as `EPSG:25833`, is the coordinate system of a map that does not state it,
/// or states a wrong one. `corners` are those of a picture without georeference, degrees: longitude and latitude of the lower left one,
/// then of the upper right one. `zoom` takes another zoom of a map of tiles than the finest one. `model` is a model file, if not the bundled
/// one, which a `Localizer` then needs as well; `precision` is `mixed`, `f32` or `int8`. `overwrite` allows to replace a file that is no
/// pack; the map is never replaced.
///
/// `progress` is called with a `BuildProgress` after each piece of work. An exception in it, and Ctrl-C, end the build; the same
/// call continues it.
#[pyfunction]
#[pyo3(signature = (
    map, out, *, gsd_m=None, adapt=false, crs=None, corners=None, zoom=None, model=None, precision=None, overwrite=false, progress=None
))]
#[allow(
    clippy::too_many_arguments,
    reason = "keyword arguments of a Python function"
)]
pub fn build_pack(
    py: Python<'_>,
    map: PathBuf,
    out: PathBuf,
    gsd_m: Option<&Bound<'_, PyAny>>,
    adapt: bool,
    crs: Option<String>,
    corners: Option<[f64; 4]>,
    zoom: Option<i64>,
    model: Option<PathBuf>,
    precision: Option<&str>,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<BuildReport> {
    let zoom = zoom
        .map(|zoom| whole_number("zoom", zoom, u8::MAX))
        .transpose()?;
    let gsd_m = gsd_m.map(resolutions).transpose()?;
    let mut raised = None;
    let built = detached_with_threads(py, || {
        OutputPolicy::new()
            .overwrite(overwrite)
            .protect(&map)
            .protect_all(&model)
            .check_file(&out, &[&grimnet_pack::format::MAGIC])
            .map_err(|error| output_error(&error))?;
        let options = MapBuild {
            map: MapOptions {
                crs,
                corners,
                zoom,
                ..MapOptions::default()
            },
            pack: BuildOptions {
                levels: gsd_m.map_or(Levels::Auto, Levels::Gsd),
                adapt,
                ..BuildOptions::standard()
            },
            model: Some(open_model(model.as_ref(), precision)?),
            overwrite,
            ..MapBuild::default()
        };
        Ok(build_interruptible(
            &map,
            &out,
            &options,
            |now| match Python::attach(|py| notify(py, now, progress.as_ref())) {
                Ok(()) => ControlFlow::Continue(()),
                Err(error) => {
                    raised = Some(error);
                    ControlFlow::Break(())
                }
            },
        ))
    })?;
    let report = match (built, raised) {
        (_, Some(raised)) => return Err(raised),
        (Ok(report), None) => report,
        (Err(error), None) => return Err(build_error(&error)),
    };
    Ok(BuildReport {
        path: report.path,
        len_bytes: report.len_bytes,
        tiles: report.tiles,
        tiles_skipped: report.tiles_skipped,
        tiles_resumed: report.tiles_resumed,
        was_complete: report.was_complete,
        duration_s: report.duration.as_secs_f64(),
    })
}

/// Calls `progress`, and lets Python handle Ctrl-C.
fn notify(
    py: Python<'_>,
    now: &grimnet::map::Progress,
    progress: Option<&Py<PyAny>>,
) -> PyResult<()> {
    py.check_signals()?;
    let Some(progress) = progress else {
        return Ok(());
    };
    let report = BuildProgress {
        phase: match now.phase {
            Phase::Adapting => "adapting",
            Phase::Tiles => "tiles",
            Phase::Writing => "writing",
        },
        gsd_m: now.gsd_m,
        tiles_done: now.tiles_done,
        tiles_total: now.tiles_total,
        time_left_s: now.time_left.map(|left| left.as_secs_f64()),
    };
    progress.call1(py, (report,)).map(drop)
}
