//! `FeatureExtractor` and `Features`: the network's output for one picture.

use std::path::PathBuf;

use grimnet_net::{Domain, ExtractOptions, Extractor, SIZE_MULTIPLE_PX};
use image::{GrayImage, Luma, RgbImage};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::errors::{invalid_value, model_error, whole_number};
use crate::long_work::detached;
use crate::model_file::open_model;
use crate::photo_input::{PhotoInput, max_side_of};

/// The network for photos or maps. Threads may share it. It keeps memory for its largest picture, once for each thread that uses it at
/// the same time.
///
/// `model` is a model file, if not the bundled one; `precision` is `mixed`, `f32` or `int8`; `domain` is `uav` for photos, `sat` for maps.
#[pyclass(frozen, module = "grimnet")]
pub struct FeatureExtractor {
    extractor: Extractor,
}

/// Keypoints, local descriptors and the global descriptor of one picture. The arrays cannot be written to.
#[pyclass(frozen, module = "grimnet")]
pub struct Features {
    /// n x 2: column and row, strongest first. As in OpenCV the centre of the top left pixel is (0, 0).
    #[pyo3(get)]
    keypoints_px: Py<PyArray2<f32>>,
    /// n: probabilities of the keypoints, 0 to 1.
    #[pyo3(get)]
    scores: Py<PyArray1<f32>>,
    /// n x dimension: a unit vector for each keypoint.
    #[pyo3(get)]
    pub(crate) descriptors: Py<PyArray2<f32>>,
    /// The global descriptor, a unit vector.
    #[pyo3(get)]
    global_descriptor: Py<PyArray1<f32>>,
    /// Width and height of the picture that the keypoints are in.
    #[pyo3(get)]
    size_px: (u32, u32),
    /// Width and height of the picture before it was reduced.
    #[pyo3(get)]
    full_size_px: (u32, u32),
}

#[pymethods]
impl FeatureExtractor {
    #[new]
    #[pyo3(signature = (*, model=None, precision=None, domain="uav"))]
    fn new(
        py: Python<'_>,
        model: Option<PathBuf>,
        precision: Option<&str>,
        domain: &str,
    ) -> PyResult<Self> {
        let domain = match domain {
            "uav" => Domain::Uav,
            "sat" => Domain::Sat,
            other => {
                return Err(invalid_value(format!(
                    "domain is {other:?}; expected \"uav\" for photos or \"sat\" for maps"
                )));
            }
        };
        let extractor = detached(py, || {
            let model = open_model(model.as_ref(), precision)?;
            Extractor::new(&model, domain).map_err(|error| model_error(&error))
        })?;
        Ok(Self { extractor })
    }

    /// The features of a picture. One with a longer side than `max_side_px` is reduced to it by averaging areas; `None` takes it as it
    /// is. Of the keypoints with a probability above `threshold`, 0 to 1, that are the strongest within `nms_radius_px` pixels, the
    /// `max_keypoints` strongest are taken.
    #[pyo3(signature = (picture, *, max_keypoints=1024, threshold=0.005, nms_radius_px=2, max_side_px=1024))]
    fn features<'py>(
        &self,
        picture: &Bound<'py, PyAny>,
        max_keypoints: i64,
        threshold: f32,
        nms_radius_px: i64,
        max_side_px: Option<i64>,
    ) -> PyResult<Features> {
        let py = picture.py();
        let max_side_px = max_side_of(max_side_px)?;
        let input = PhotoInput::of(picture)?;
        if !(0.0..=1.0).contains(&threshold) {
            return Err(invalid_value(format!(
                "threshold is {threshold}; expected a number from 0 to 1"
            )));
        }
        let options = ExtractOptions {
            threshold,
            max_keypoints: whole_number("max_keypoints", max_keypoints, usize::MAX)?,
            nms_radius_px: whole_number("nms_radius_px", nms_radius_px, u32::MAX)?,
        };
        let (photo, found) = detached(py, || {
            let photo = input.decode(max_side_px)?;
            let (padded, mask) = padded(&photo.image);
            let found = self
                .extractor
                .extract(&padded, Some(&mask), &options)
                .map_err(|error| model_error(&error))?;
            Ok((photo, found))
        })?;
        py.check_signals()?;
        let points: Vec<f32> = found
            .keypoints
            .iter()
            .flat_map(|point| [point.x_px, point.y_px])
            .collect();
        let scores: Vec<f32> = found.keypoints.iter().map(|point| point.score).collect();
        let count = scores.len();
        let rows = |values: Vec<f32>, columns: usize| -> PyResult<Py<PyArray2<f32>>> {
            let array = values.into_pyarray(py).reshape([count, columns])?;
            read_only(&array)?;
            Ok(array.unbind())
        };
        let row = |values: Vec<f32>| -> PyResult<Py<PyArray1<f32>>> {
            let array = values.into_pyarray(py);
            read_only(&array)?;
            Ok(array.unbind())
        };
        Ok(Features {
            keypoints_px: rows(points, 2)?,
            scores: row(scores)?,
            descriptors: rows(found.descriptors, found.descriptor_dim)?,
            global_descriptor: row(found.global)?,
            size_px: photo.image.dimensions(),
            full_size_px: photo.full_size_px,
        })
    }

    fn __repr__(&self) -> String {
        format!("FeatureExtractor({:?})", self.extractor)
    }
}

#[pymethods]
impl Features {
    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.scores.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (width, height) = self.size_px;
        Ok(format!(
            "Features({} keypoints of a picture of {width} x {height} px)",
            self.__len__(py)?
        ))
    }
}

fn read_only(array: &Bound<'_, PyAny>) -> PyResult<()> {
    array.call_method1("setflags", (false,)).map(drop)
}

/// The picture with sides that the network takes, and a mask in which the added pixels are 0.
fn padded(image: &RgbImage) -> (RgbImage, GrayImage) {
    let (width, height) = image.dimensions();
    let (to_width, to_height) = (
        width.next_multiple_of(SIZE_MULTIPLE_PX),
        height.next_multiple_of(SIZE_MULTIPLE_PX),
    );
    let mut padded = RgbImage::new(to_width, to_height);
    image::imageops::replace(&mut padded, image, 0, 0);
    let mask = GrayImage::from_fn(to_width, to_height, |x, y| {
        Luma([if x < width && y < height { 255 } else { 0 }])
    });
    (padded, mask)
}
