//! `Localizer`.

use std::path::PathBuf;
use std::sync::Arc;

use grimnet_locate::{Gates, Options};
use grimnet_pack::Pack;
use pyo3::prelude::*;

use crate::answers::answer_object;
use crate::errors::{locate_error, pack_error};
use crate::long_work::detached;
use crate::model_file::open_model;
use crate::photo_input::PhotoInput;
use crate::prior_arguments::PriorArguments;

/// Localises photos on the map of one pack. Threads may share it.
///
/// `model` is the file of the model that the pack was built with, if not the bundled one; `precision` is `mixed`, `f32` or `int8`.
/// `map_error_m` is the position error of the map itself, metres (1 sigma per axis; 1 if it is not given), which the stated radius
/// includes. `min_confidence` is the smallest confidence of a fix, 0 to 1, if not that of the model's calibration. After `budget_ms`
/// milliseconds the search of a photo stops, between two ground widths.
#[pyclass(frozen, module = "grimnet")]
pub struct Localizer {
    /// The library's localiser.
    pub inner: Arc<grimnet_locate::Localizer>,
}

#[pymethods]
impl Localizer {
    #[new]
    #[pyo3(signature = (
        pack, *, model=None, precision=None, map_error_m=None, min_confidence=None, budget_ms=None
    ))]
    fn new(
        py: Python<'_>,
        pack: PathBuf,
        model: Option<PathBuf>,
        precision: Option<&str>,
        map_error_m: Option<f64>,
        min_confidence: Option<f64>,
        budget_ms: Option<f64>,
    ) -> PyResult<Self> {
        let defaults = Options::default();
        let options = Options {
            map_error_m: map_error_m.unwrap_or(defaults.map_error_m),
            budget_ms,
            gates: defaults.gates.map(|gates| Gates {
                min_confidence,
                ..gates
            }),
            ..defaults
        };
        let inner = detached(py, || {
            options.check().map_err(|error| locate_error(&error))?;
            let model = open_model(model.as_ref(), precision)?;
            let pack = Pack::open(&pack).map_err(|error| pack_error(&error))?;
            grimnet_locate::Localizer::new(model, pack).map_err(|error| locate_error(&error))
        })?;
        Ok(Self {
            inner: Arc::new(inner.with_options(options)),
        })
    }

    /// Finds the position of a photo's centre: `Fix`, or `NoFix` with the reason.
    ///
    /// `photo` is a path, the bytes of a picture file, or an array of height x width x 3 of uint8, red, green, blue. What is known of it
    /// besides overrides its metadata. `heading` is the direction of its top edge, degrees clockwise from true north, with the error
    /// `heading_sigma_deg` (1 sigma; 5 if it is not given); or `exif`, from the metadata, or `unknown`. `pitch_deg` is that of the camera,
    /// degrees: -90 looks straight down. `height_agl_m` is the height above ground, metres, and `hfov_deg` the field of view across the
    /// photo's width, degrees; in place of both `gsd_m` is the ground resolution of the full-size photo, metres per pixel. `near` is the
    /// area to search: latitude, longitude (degrees) and radius (metres).
    #[pyo3(signature = (
        photo, *, heading=None, heading_sigma_deg=None, pitch_deg=None, height_agl_m=None, hfov_deg=None, gsd_m=None, near=None
    ))]
    #[allow(
        clippy::too_many_arguments,
        reason = "keyword arguments of a Python method"
    )]
    fn locate<'py>(
        &self,
        photo: &Bound<'py, PyAny>,
        heading: Option<&Bound<'py, PyAny>>,
        heading_sigma_deg: Option<f64>,
        pitch_deg: Option<f64>,
        height_agl_m: Option<f64>,
        hfov_deg: Option<f64>,
        gsd_m: Option<f64>,
        near: Option<[f64; 3]>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = photo.py();
        let prior = PriorArguments {
            heading,
            heading_sigma_deg,
            pitch_deg,
            height_agl_m,
            hfov_deg,
            gsd_m,
            near,
        }
        .prior()?;
        let input = PhotoInput::of(photo)?;
        let name = input.name();
        let outcome = detached(py, || {
            let photo = input.decode_as_needed(&self.inner.needed_pixels(&prior))?;
            self.inner
                .locate(&photo, &prior)
                .map_err(|error| locate_error(&error))
        });
        // Ctrl-C during the search.
        py.check_signals()?;
        answer_object(py, &name, &outcome?)
    }

    /// The pack's file.
    #[getter]
    fn pack(&self) -> PathBuf {
        self.inner.pack().path().to_path_buf()
    }

    /// Ground resolutions of the pack's levels, metres per pixel.
    #[getter]
    fn levels_gsd_m(&self) -> Vec<f64> {
        let levels = self.inner.pack().levels();
        levels.iter().map(|level| level.gsd_m()).collect()
    }

    fn __repr__(&self) -> String {
        format!("Localizer({:?})", self.inner.pack().path())
    }
}
