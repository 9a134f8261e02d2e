//! `Tracker`: follows a flight over its frames.

use std::sync::{Mutex, MutexGuard, PoisonError};

use grimnet_flight::{Flight, FlightOptions, Known};
use grimnet_geo::LonLat;
use grimnet_track::{Attitude, FixedMount, Height, Input, Start, TrackOptions, Vehicle, Velocity};
use pyo3::prelude::*;

use crate::answers::answer_object;
use crate::errors::{invalid_value, locate_error};
use crate::localizer::Localizer;
use crate::long_work::detached;
use crate::photo_input::PhotoInput;
use crate::prior_arguments::PriorArguments;
use crate::track_point::TrackPoint;

/// Follows one aircraft: each frame is searched where the track says, and its fix moves the track on.
///
/// `vehicle` is `multirotor` or `plane`. `start` is the aircraft's place at the first frame, if it is known: latitude and longitude,
/// degrees, and the radius in metres that holds it with 95 % probability. `focal_length_px` is that of the full-size photos, pixels, if
/// neither their metadata nor `hfov_deg` tell it. `camera_mount` is how a camera without a gimbal is mounted, degrees: where the picture's
/// top points, clockwise from the aircraft's nose, and the camera's pitch, -90 straight down; 0 and -90 if it is not given.
#[pyclass(frozen, module = "grimnet")]
pub struct Tracker {
    flight: Mutex<Flight>,
    mount: FixedMount,
}

impl Tracker {
    fn flight(&self) -> MutexGuard<'_, Flight> {
        // A flight may be in any state.
        self.flight.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, py: Python<'_>, input: Input) -> PyResult<()> {
        py.detach(|| self.flight().push(input))
            .map(drop)
            .map_err(invalid_value)
    }

    /// Takes in the camera's attitude that follows from `given`, whose angles are checked as they are given: of one that is not finite
    /// the camera's has others that are not.
    fn push_camera(
        &self,
        py: Python<'_>,
        given: Attitude,
        camera: impl FnOnce(Attitude) -> Attitude,
    ) -> PyResult<()> {
        Input::Attitude(given).validate().map_err(invalid_value)?;
        self.push(py, Input::Attitude(camera(given)))
    }
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(signature = (localizer, *, vehicle="multirotor", start=None, focal_length_px=None, camera_mount=None))]
    fn new(
        localizer: &Bound<'_, Localizer>,
        vehicle: &str,
        start: Option<[f64; 3]>,
        focal_length_px: Option<f64>,
        camera_mount: Option<[f64; 2]>,
    ) -> PyResult<Self> {
        let vehicle = match vehicle {
            "multirotor" => Vehicle::Multirotor,
            "plane" => Vehicle::Plane,
            other => {
                return Err(invalid_value(format!(
                    "vehicle is {other:?}; expected \"multirotor\" or \"plane\""
                )));
            }
        };
        let mount = camera_mount.map_or(Ok(FixedMount::default()), |[yaw_deg, pitch_deg]| {
            let text = format!("{yaw_deg},{pitch_deg}");
            text.parse()
                .map_err(|expected| invalid_value(format!("camera_mount is {text}; {expected}")))
        })?;
        let options = FlightOptions {
            track: TrackOptions {
                vehicle,
                start: start.map(|[lat_deg, lon_deg, radius95_m]| Start {
                    lonlat: LonLat::new(lon_deg, lat_deg),
                    radius95_m,
                }),
                focal_length_px,
                ..TrackOptions::default()
            },
            ..FlightOptions::default()
        };
        let flight = Flight::new(localizer.get().inner.clone(), options).map_err(invalid_value)?;
        Ok(Self {
            flight: Mutex::new(flight),
            mount,
        })
    }

    /// Takes in a frame that was exposed at `time_s` (seconds, one clock for all inputs) and gives the track at that time. What is
    /// known of the photo is given as for `Localizer.locate`. A frame of the same time as an earlier one is the same exposure: it is
    /// searched and answered, and is no more evidence.
    #[pyo3(signature = (
        photo, time_s, *, heading=None, heading_sigma_deg=None, pitch_deg=None, height_agl_m=None, hfov_deg=None, gsd_m=None, near=None
    ))]
    #[allow(
        clippy::too_many_arguments,
        reason = "keyword arguments of a Python method"
    )]
    fn frame<'py>(
        &self,
        photo: &Bound<'py, PyAny>,
        time_s: f64,
        heading: Option<&Bound<'py, PyAny>>,
        heading_sigma_deg: Option<f64>,
        pitch_deg: Option<f64>,
        height_agl_m: Option<f64>,
        hfov_deg: Option<f64>,
        gsd_m: Option<f64>,
        near: Option<[f64; 3]>,
    ) -> PyResult<TrackPoint> {
        let py = photo.py();
        if !time_s.is_finite() {
            return Err(invalid_value(format!(
                "time_s is {time_s}; expected a finite number of seconds"
            )));
        }
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
        let known = Known {
            prior,
            attitude: None,
        };
        let found = detached(py, || {
            let needed = self.flight().localizer().needed_pixels(&known.prior);
            let photo = input.decode_as_needed(&needed)?;
            Ok(self.flight().frame(&photo, time_s, &known))
        });
        // Ctrl-C during the search.
        py.check_signals()?;
        let found = found?;
        let outcome = found.outcome.map_err(|error| locate_error(&error))?;
        let answer = answer_object(py, &name, &outcome)?.unbind();
        Ok(TrackPoint::new(time_s, found.point.as_ref(), Some(answer)))
    }

    /// The track at a time, which may be later than the last frame.
    fn point_at(&self, py: Python<'_>, time_s: f64) -> TrackPoint {
        let point = py.detach(|| self.flight().point_at(time_s));
        TrackPoint::new(time_s, point.as_ref(), None)
    }

    /// What is wrong with the times of the inputs and with the telemetry, a sentence each, where enough of them agree on it.
    fn warnings(&self, py: Python<'_>) -> Vec<String> {
        py.detach(|| {
            let flight = self.flight();
            flight
                .warnings()
                .map(|warning| warning.to_string())
                .collect()
        })
    }

    /// Attitude of an aircraft on which the camera is mounted as `camera_mount` says, degrees: yaw clockwise from true north, pitch with
    /// the nose up, roll with the right side down.
    #[pyo3(signature = (time_s, *, yaw_deg, pitch_deg, roll_deg))]
    fn push_attitude(
        &self,
        py: Python<'_>,
        time_s: f64,
        yaw_deg: f64,
        pitch_deg: f64,
        roll_deg: f64,
    ) -> PyResult<()> {
        let aircraft = Attitude {
            time_s,
            yaw_deg,
            pitch_deg,
            roll_deg,
        };
        self.push_camera(py, aircraft, |aircraft| self.mount.camera(aircraft))
    }

    /// Attitude of a gimbal, degrees: its pitch is -90 where it looks straight down, as DJI and MAVLink report it.
    #[pyo3(signature = (time_s, *, yaw_deg, pitch_deg, roll_deg))]
    fn push_gimbal(
        &self,
        py: Python<'_>,
        time_s: f64,
        yaw_deg: f64,
        pitch_deg: f64,
        roll_deg: f64,
    ) -> PyResult<()> {
        let gimbal = Attitude {
            time_s,
            yaw_deg,
            pitch_deg,
            roll_deg,
        };
        self.push_camera(py, gimbal, |_| {
            Attitude::from_gimbal(time_s, yaw_deg, pitch_deg, roll_deg)
        })
    }

    /// Height above the ground below, and altitude above mean sea level, metres.
    #[pyo3(signature = (time_s, *, agl_m, amsl_m=None))]
    fn push_height(
        &self,
        py: Python<'_>,
        time_s: f64,
        agl_m: f64,
        amsl_m: Option<f64>,
    ) -> PyResult<()> {
        self.push(
            py,
            Input::Height(Height {
                time_s,
                agl_m,
                amsl_m,
            }),
        )
    }

    /// Velocity over ground, metres per second, with its error per axis (1 sigma).
    #[pyo3(signature = (time_s, *, east_m_s, north_m_s, sigma_m_s))]
    fn push_velocity(
        &self,
        py: Python<'_>,
        time_s: f64,
        east_m_s: f64,
        north_m_s: f64,
        sigma_m_s: f64,
    ) -> PyResult<()> {
        self.push(
            py,
            Input::Velocity(Velocity {
                time_s,
                east_m_s,
                north_m_s,
                sigma_m_s,
            }),
        )
    }
}
