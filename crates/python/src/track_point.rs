//! `TrackPoint`: one instant of a track, with the fields of the program's JSON line.

use grimnet_track::{Estimate, PositionOf, Source, TrackState};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::answers::covariance_array;

/// One instant of a track. The position is `None` in every state but `tracking` and `coasting`.
#[pyclass(frozen, module = "grimnet")]
pub struct TrackPoint {
    /// Seconds on the clock of the frames.
    #[pyo3(get)]
    time_s: f64,
    /// `searching`, `tracking`, `coasting`, `ambiguous` or `lost`.
    #[pyo3(get)]
    state: &'static str,
    estimate: Option<Estimate>,
    /// Seconds since the last fix that was accepted.
    #[pyo3(get)]
    age_of_last_fix_s: Option<f64>,
    /// The answer for the frame alone: `Fix`, `NoFix`, or `None` if the instant is not that of a frame.
    #[pyo3(get)]
    answer: Option<Py<PyAny>>,
}

impl TrackPoint {
    /// The track at a time; `point` is `None` where it is not known.
    pub fn new(
        time_s: f64,
        point: Option<&grimnet_track::TrackPoint>,
        answer: Option<Py<PyAny>>,
    ) -> Self {
        let state = point.map_or(TrackState::Searching, |point| point.state);
        let any = point.and_then(|point| point.estimate);
        Self {
            time_s,
            state: match state {
                TrackState::Tracking => "tracking",
                TrackState::Coasting => "coasting",
                TrackState::Ambiguous => "ambiguous",
                TrackState::Lost => "lost",
                _ => "searching",
            },
            estimate: any.filter(|_| state.is_usable()),
            age_of_last_fix_s: any.and_then(|estimate| estimate.age_of_last_fix_s),
            answer,
        }
    }
}

#[pymethods]
impl TrackPoint {
    /// Latitude, degrees, WGS 84.
    #[getter]
    fn lat_deg(&self) -> Option<f64> {
        self.estimate.map(|e| e.lat_deg)
    }

    /// Longitude, degrees, WGS 84.
    #[getter]
    fn lon_deg(&self) -> Option<f64> {
        self.estimate.map(|e| e.lon_deg)
    }

    /// Heading of the camera's frame, degrees clockwise from true north.
    #[getter]
    fn heading_deg(&self) -> Option<f64> {
        self.estimate.and_then(|e| e.heading_deg)
    }

    /// Its standard deviation, degrees.
    #[getter]
    fn heading_sigma_deg(&self) -> Option<f64> {
        self.estimate.and_then(|e| e.heading_sigma_deg)
    }

    /// Radius in metres that should hold the truth in 95 % of cases.
    #[getter]
    fn radius95_m(&self) -> Option<f64> {
        self.estimate.map(|e| e.radius95_m)
    }

    /// Covariance in square metres, 2 x 2: first east, then north.
    #[getter]
    fn covariance_en_m2<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let covariance = self.estimate.map(|e| e.covariance_en_m2);
        covariance.map(|c| covariance_array(py, c)).transpose()
    }

    /// Metres per second to the east.
    #[getter]
    fn velocity_east_m_s(&self) -> Option<f64> {
        self.estimate.map(|e| e.velocity_east_m_s)
    }

    /// Metres per second to the north.
    #[getter]
    fn velocity_north_m_s(&self) -> Option<f64> {
        self.estimate.map(|e| e.velocity_north_m_s)
    }

    /// Height above ground, metres.
    #[getter]
    fn height_agl_m(&self) -> Option<f64> {
        self.estimate.and_then(|e| e.height_agl_m)
    }

    /// Altitude above mean sea level, metres.
    #[getter]
    fn altitude_amsl_m(&self) -> Option<f64> {
        self.estimate.and_then(|e| e.altitude_amsl_m)
    }

    /// `aircraft`, `aircraft_without_attitude` or `image_centre`: what the position is of.
    #[getter]
    fn position_of(&self) -> Option<&'static str> {
        self.estimate.map(|e| match e.position_of {
            PositionOf::Aircraft => "aircraft",
            PositionOf::AircraftWithoutAttitude => "aircraft_without_attitude",
            _ => "image_centre",
        })
    }

    /// What the position rests on: `fix`, `velocity`, `motion` or `prediction`.
    #[getter]
    fn source(&self) -> Option<&'static str> {
        self.estimate.map(|e| match e.source {
            Source::Fix => "fix",
            Source::Velocity => "velocity",
            Source::Motion => "motion",
            _ => "prediction",
        })
    }

    /// The track's fields as the JSON line of `grim track` has them, not rounded, with `time_s` in place of `time`, and
    /// `heading_sigma_deg`. What the line says of the frame (`photo`, `frame`, `reason`, `time_ms`) is in `answer`.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("time_s", self.time_s)?;
        dict.set_item("state", self.state)?;
        dict.set_item("lat_deg", self.lat_deg())?;
        dict.set_item("lon_deg", self.lon_deg())?;
        dict.set_item("heading_deg", self.heading_deg())?;
        dict.set_item("heading_sigma_deg", self.heading_sigma_deg())?;
        dict.set_item("radius95_m", self.radius95_m())?;
        let covariance = self.estimate.map(|e| e.covariance_en_m2.to_vec());
        dict.set_item("covariance_en_m2", covariance)?;
        dict.set_item("age_of_last_fix_s", self.age_of_last_fix_s)?;
        dict.set_item("velocity_east_m_s", self.velocity_east_m_s())?;
        dict.set_item("velocity_north_m_s", self.velocity_north_m_s())?;
        dict.set_item("height_agl_m", self.height_agl_m())?;
        dict.set_item("altitude_amsl_m", self.altitude_amsl_m())?;
        dict.set_item("position_of", self.position_of())?;
        dict.set_item("source", self.source())?;
        Ok(dict)
    }

    fn __repr__(&self) -> String {
        match self.estimate {
            Some(e) => format!(
                "TrackPoint(time_s={}, state='{}', lat_deg={:.7}, lon_deg={:.7}, radius95_m={:.1})",
                self.time_s, self.state, e.lat_deg, e.lon_deg, e.radius95_m
            ),
            None => format!("TrackPoint(time_s={}, state='{}')", self.time_s, self.state),
        }
    }
}
