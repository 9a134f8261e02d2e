//! What a localiser answers: `Fix` and `NoFix`, with the fields of the program's JSON line.

use std::collections::BTreeMap;

use grimnet_answer::{Answer, State};
use grimnet_locate::Outcome;
use numpy::{PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::invalid_value;

/// A 2 x 2 covariance as an array, from east-east, east-north, north-north.
pub fn covariance_array<'py>(
    py: Python<'py>,
    [ee, en, nn]: [f64; 3],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    [ee, en, en, nn].to_pyarray(py).reshape([2, 2])
}

/// The dictionary of a JSON object.
fn dict_of<'py>(py: Python<'py>, json: &str) -> PyResult<Bound<'py, PyDict>> {
    let loaded = py.import("json")?.call_method1("loads", (json,))?;
    Ok(loaded.cast_into::<PyDict>()?)
}

fn json_of(answer: &Answer) -> PyResult<String> {
    serde_json::to_string(answer).map_err(invalid_value)
}

fn read(json: &str, state: State) -> PyResult<Answer> {
    let answer: Answer = serde_json::from_str(json).map_err(invalid_value)?;
    if answer.state == state {
        Ok(answer)
    } else {
        Err(invalid_value(
            "the answer is of the other kind; look at its `state`",
        ))
    }
}

/// `Fix` or `NoFix`.
///
/// # Errors
/// The interpreter is out of memory.
pub fn answer_object<'py>(
    py: Python<'py>,
    photo: &str,
    outcome: &Outcome,
) -> PyResult<Bound<'py, PyAny>> {
    let answer = Answer::of(photo, outcome);
    Ok(match outcome {
        Outcome::Fix(_) => Bound::new(py, Fix { answer })?.into_any(),
        Outcome::NoFix(_) => Bound::new(py, NoFix { answer })?.into_any(),
    })
}

/// A position. It is true as a condition.
#[pyclass(frozen, eq, module = "grimnet")]
#[derive(Debug, Clone, PartialEq)]
pub struct Fix {
    answer: Answer,
}

/// No position, and why. It is false as a condition.
#[pyclass(frozen, eq, module = "grimnet")]
#[derive(Debug, Clone, PartialEq)]
pub struct NoFix {
    answer: Answer,
}

/// The methods that both answers have, and those of one.
macro_rules! answer_methods {
    ($class:ident, $state:expr, $is_fix:literal, { $($own:item)* }) => {
        #[pymethods]
        impl $class {
            /// The photo's path as given, or `bytes`, or `array`.
            #[getter]
            fn photo(&self) -> &str {
                &self.answer.photo
            }

            /// `fix` or `no_fix`.
            #[getter]
            fn state(&self) -> &'static str {
                if $is_fix { "fix" } else { "no_fix" }
            }

            /// Milliseconds by stage, and `total`.
            #[getter]
            fn time_ms(&self) -> BTreeMap<String, f64> {
                self.answer.time_ms.clone()
            }

            /// Metadata and arguments that were used.
            #[getter]
            fn used(&self) -> Vec<String> {
                self.answer.used.iter().map(ToString::to_string).collect()
            }

            /// Metadata that were not used, with the reason.
            #[getter]
            fn set_aside(&self) -> Vec<String> {
                self.answer.set_aside.iter().map(ToString::to_string).collect()
            }

            /// Assumptions about heading and scale if nothing was known.
            #[getter]
            fn assumed(&self) -> Option<&str> {
                self.answer.assumed.as_deref()
            }

            /// Matches that agree with the transform.
            #[getter]
            fn inliers(&self) -> usize {
                self.answer.inliers.unwrap_or_default()
            }

            /// Mutual matches before geometric verification.
            #[getter]
            fn matches(&self) -> usize {
                self.answer.matches.unwrap_or_default()
            }

            /// The answer as the JSON line of `grim locate`.
            fn to_json(&self) -> PyResult<String> {
                json_of(&self.answer)
            }

            /// The answer with the fields of the JSON line of `grim locate`.
            fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
                dict_of(py, &json_of(&self.answer)?)
            }

            /// The answer of a JSON line.
            #[staticmethod]
            fn from_json(json: &str) -> PyResult<Self> {
                Ok(Self { answer: read(json, $state)? })
            }

            fn __reduce__<'py>(
                slf: &Bound<'py, Self>,
            ) -> PyResult<(Bound<'py, PyAny>, (String,))> {
                let from_json = slf.get_type().getattr("from_json")?;
                Ok((from_json, (json_of(&slf.get().answer)?,)))
            }

            fn __bool__(&self) -> bool {
                $is_fix
            }

            $($own)*
        }
    };
}

answer_methods!(Fix, State::Fix, true, {
    /// Latitude of the image centre, degrees, WGS 84.
    #[getter]
    fn lat_deg(&self) -> f64 {
        self.answer.lat_deg.unwrap_or(f64::NAN)
    }

    /// Longitude of the image centre, degrees, WGS 84.
    #[getter]
    fn lon_deg(&self) -> f64 {
        self.answer.lon_deg.unwrap_or(f64::NAN)
    }

    /// Direction of the photo's top edge, degrees clockwise from true north.
    #[getter]
    fn heading_deg(&self) -> Option<f64> {
        self.answer.heading_deg
    }

    /// Ground resolution of the full-size photo, metres per pixel.
    #[getter]
    fn gsd_m(&self) -> f64 {
        self.answer.gsd_m.unwrap_or(f64::NAN)
    }

    /// Radius in metres that should hold the truth in 95 % of cases.
    #[getter]
    fn radius95_m(&self) -> f64 {
        self.answer.radius95_m.unwrap_or(f64::NAN)
    }

    /// Covariance in square metres, 2 x 2: first east, then north. The dictionary and the JSON line have its three numbers.
    #[getter]
    fn covariance_en_m2<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        covariance_array(py, self.answer.covariance_en_m2.unwrap_or([f64::NAN; 3]))
    }

    /// Probability that the position is right and not another place; `None` if the model was not calibrated.
    #[getter]
    fn confidence(&self) -> Option<f64> {
        self.answer.confidence
    }

    /// Inliers of the best candidate at another place.
    #[getter]
    fn runner_up_inliers(&self) -> Option<usize> {
        self.answer.runner_up_inliers
    }

    /// Corners of the photo on the ground, 4 x 2: longitude and latitude in degrees, clockwise from the top left. Corners beyond the
    /// horizon are left out: 3 x 2, or 0 x 2 if fewer than three remain.
    #[getter]
    fn outline_lon_lat_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let corners = self
            .answer
            .outline_lon_lat_deg
            .as_deref()
            .unwrap_or_default();
        corners
            .as_flattened()
            .to_pyarray(py)
            .reshape([corners.len(), 2])
    }

    fn __repr__(&self) -> String {
        let confidence = self
            .answer
            .confidence
            .map(|value| format!(", confidence={value:.3}"));
        format!(
            "Fix({:?}, lat_deg={:.7}, lon_deg={:.7}, radius95_m={:.1}{})",
            self.answer.photo,
            self.lat_deg(),
            self.lon_deg(),
            self.radius95_m(),
            confidence.unwrap_or_default()
        )
    }
});

answer_methods!(NoFix, State::NoFix, false, {
    /// Why there is no position.
    #[getter]
    fn reason(&self) -> &str {
        self.answer.reason.as_deref().unwrap_or_default()
    }

    /// Whether the photo's file is damaged.
    #[getter]
    fn damaged(&self) -> bool {
        self.answer.damaged
    }

    fn __repr__(&self) -> String {
        format!("NoFix({:?}, reason={:?})", self.answer.photo, self.reason())
    }
});
