//! What the filter takes in, each with the time at which it was true (not the time at which it arrived).

use std::cmp::Ordering;

use grimnet_geo::LonLat;
use nalgebra::{Rotation3, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::InputError;

/// A position measured from one photo: the ground point at the photo's centre.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PositionFix {
    /// Exposure time, seconds on the clock that all inputs share.
    pub time_s: f64,
    /// Ground point at the photo's centre.
    pub lonlat: LonLat,
    /// 1-sigma covariance without the map's own error, square metres: east-east, east-north, north-north.
    pub covariance_en_m2: [f64; 3],
    /// The map's own error, metres, 1 sigma per axis. It is the same for all fixes of a flight, so it is not averaged away.
    pub map_error_m: f64,
    /// Bearing of the photo's top, degrees clockwise from true north. `None` if unknown.
    pub heading_deg: Option<f64>,
    /// Ground metres per pixel of the full-size photo, at its centre.
    pub gsd_m: f64,
    /// Calibrated probability in `[0, 1]` that the fix is right and not another place that looks alike.
    pub confidence: f64,
}

/// Motion of the camera over ground between two frames, measured from the frames themselves.
///
/// The displacement is that of the camera, not of the image centre: whoever measures it removes the change of tilt, if it is
/// known. Scale is not part of it, because scales chained over frames drift: the filter takes the ground resolution from the
/// last fix and the height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RelativeMotion {
    /// Exposure time of the first frame, seconds.
    pub from_time_s: f64,
    /// Exposure time of the second frame, seconds.
    pub time_s: f64,
    /// Displacement towards the top of the first photo, pixels that the full-size photo has straight below the camera (focal
    /// length over height).
    pub forward_px: f64,
    /// Displacement towards the right of the first photo, the same pixels.
    pub right_px: f64,
    /// Turn of the photo's top from the first frame to the second, degrees clockwise.
    pub turn_deg: f64,
    /// Random error of the displacement, pixels, 1 sigma per axis.
    pub sigma_px: f64,
}

/// Attitude of the frame that carries the camera: of the gimbal, or of the aircraft where the camera is fixed to it.
///
/// Rotations in the order yaw, pitch, roll (Z-Y-X) from north-east-down. With pitch and roll 0 the camera looks straight down
/// and the photo's top points to `yaw_deg`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Attitude {
    /// Seconds.
    pub time_s: f64,
    /// Degrees clockwise from true north.
    pub yaw_deg: f64,
    /// Degrees, positive with the nose up: a camera that looks down then looks ahead.
    pub pitch_deg: f64,
    /// Degrees, positive with the right side down: a camera that looks down then looks to the left.
    pub roll_deg: f64,
}

impl Attitude {
    /// The attitude of a gimbal whose pitch is -90 degrees when it looks straight down, as DJI and MAVLink report it: its optical
    /// axis is the x axis of its frame, so that the roll turns the photo about its centre.
    pub fn from_gimbal(
        time_s: f64,
        yaw_deg: f64,
        gimbal_pitch_deg: f64,
        gimbal_roll_deg: f64,
    ) -> Self {
        let gimbal = Rotation3::from_euler_angles(
            gimbal_roll_deg.to_radians(),
            gimbal_pitch_deg.to_radians(),
            yaw_deg.to_radians(),
        );
        // The photo's top is opposite to the gimbal's z axis, and the axis of the camera's frame that looks down is the gimbal's x.
        let looks_down =
            gimbal * Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let (roll_rad, pitch_rad, yaw_rad) = looks_down.euler_angles();
        Self {
            time_s,
            yaw_deg: yaw_rad.to_degrees(),
            pitch_deg: pitch_rad.to_degrees(),
            roll_deg: roll_rad.to_degrees(),
        }
    }
}

/// Height of the aircraft.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Height {
    /// Seconds.
    pub time_s: f64,
    /// Above the ground below, metres.
    pub agl_m: f64,
    /// Above mean sea level, metres. Passed through to the output. `None` if unknown.
    pub amsl_m: Option<f64>,
}

/// Velocity over ground as the autopilot estimates it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Velocity {
    /// Seconds.
    pub time_s: f64,
    /// Metres per second to the east.
    pub east_m_s: f64,
    /// Metres per second to the north.
    pub north_m_s: f64,
    /// Error per axis, metres per second, 1 sigma. The filter expects it to change slowly, as a bias does.
    pub sigma_m_s: f64,
}

/// A frame that was searched and gave no fix. It opens the search window.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Miss {
    /// Exposure time, seconds.
    pub time_s: f64,
}

/// One input of the filter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Input {
    /// See [`Attitude`].
    Attitude(Attitude),
    /// See [`Height`].
    Height(Height),
    /// See [`Velocity`].
    Velocity(Velocity),
    /// See [`RelativeMotion`].
    Motion(RelativeMotion),
    /// See [`PositionFix`].
    Fix(PositionFix),
    /// See [`Miss`].
    Miss(Miss),
}

/// The most numbers that an input holds.
const MOST_FIELDS: usize = 10;

impl Input {
    /// The time at which the input was true, seconds.
    pub fn time_s(&self) -> f64 {
        match self {
            Self::Attitude(input) => input.time_s,
            Self::Height(input) => input.time_s,
            Self::Velocity(input) => input.time_s,
            Self::Motion(input) => input.time_s,
            Self::Fix(input) => input.time_s,
            Self::Miss(input) => input.time_s,
        }
    }

    /// What kind of input it is, in the order in which inputs of the same time are processed: what a fix needs comes first.
    fn rank(&self) -> u8 {
        match self {
            Self::Attitude(_) => 0,
            Self::Height(_) => 1,
            Self::Velocity(_) => 2,
            Self::Motion(_) => 3,
            Self::Fix(_) => 4,
            Self::Miss(_) => 5,
        }
    }

    /// All numbers, so that inputs of the same time and kind have one order. An unknown value is NaN.
    fn fields(&self) -> [f64; MOST_FIELDS] {
        let mut fields = [0.0; MOST_FIELDS];
        let mut put = |values: &[f64]| fields[..values.len()].copy_from_slice(values);
        match self {
            Self::Attitude(a) => put(&[a.yaw_deg, a.pitch_deg, a.roll_deg]),
            Self::Height(h) => put(&[h.agl_m, h.amsl_m.unwrap_or(f64::NAN)]),
            Self::Velocity(v) => put(&[v.east_m_s, v.north_m_s, v.sigma_m_s]),
            Self::Motion(m) => put(&[
                m.from_time_s,
                m.forward_px,
                m.right_px,
                m.turn_deg,
                m.sigma_px,
            ]),
            Self::Fix(f) => put(&[
                f.lonlat.lon_deg,
                f.lonlat.lat_deg,
                f.covariance_en_m2[0],
                f.covariance_en_m2[1],
                f.covariance_en_m2[2],
                f.map_error_m,
                f.heading_deg.unwrap_or(f64::NAN),
                f.gsd_m,
                f.confidence,
            ]),
            Self::Miss(_) => {}
        }
        fields
    }

    /// A total order: by time, then by kind, then by content. Equal means duplicate.
    pub(crate) fn order(&self, other: &Self) -> Ordering {
        self.time_s()
            .total_cmp(&other.time_s())
            .then(self.rank().cmp(&other.rank()))
            .then_with(|| {
                let (ours, theirs) = (self.fields(), other.fields());
                ours.iter()
                    .zip(&theirs)
                    .map(|(a, b)| a.total_cmp(b))
                    .find(|order| order.is_ne())
                    .unwrap_or(Ordering::Equal)
            })
    }

    /// Checks that every number is finite and in its range.
    ///
    /// # Errors
    /// [`InputError::Invalid`] names the first field that is not.
    pub(crate) fn validate(&self) -> Result<(), InputError> {
        require("time_s", self.time_s(), self.time_s().is_finite(), "finite")?;
        match self {
            Self::Attitude(a) => {
                finite("yaw_deg", a.yaw_deg)?;
                finite("pitch_deg", a.pitch_deg)?;
                finite("roll_deg", a.roll_deg)
            }
            Self::Height(h) => {
                let possible = h.agl_m.is_finite() && h.agl_m > 0.0;
                require("agl_m", h.agl_m, possible, "finite and above 0")?;
                h.amsl_m.map_or(Ok(()), |value| finite("amsl_m", value))
            }
            Self::Velocity(v) => {
                finite("east_m_s", v.east_m_s)?;
                finite("north_m_s", v.north_m_s)?;
                positive("sigma_m_s", v.sigma_m_s)
            }
            Self::Motion(m) => {
                finite("from_time_s", m.from_time_s)?;
                finite("forward_px", m.forward_px)?;
                finite("right_px", m.right_px)?;
                finite("turn_deg", m.turn_deg)?;
                positive("sigma_px", m.sigma_px)?;
                let before = m.from_time_s < m.time_s;
                require("from_time_s", m.from_time_s, before, "before time_s")
            }
            Self::Fix(f) => validate_fix(f),
            Self::Miss(_) => Ok(()),
        }
    }
}

fn validate_fix(fix: &PositionFix) -> Result<(), InputError> {
    let LonLat { lon_deg, lat_deg } = fix.lonlat;
    require("lat_deg", lat_deg, fix.lonlat.is_valid(), "in [-90, 90]")?;
    let on_earth = (-360.0..=360.0).contains(&lon_deg);
    require("lon_deg", lon_deg, on_earth, "in [-360, 360]")?;
    let [ee, en, nn] = fix.covariance_en_m2;
    positive("covariance_en_m2[0]", ee)?;
    positive("covariance_en_m2[2]", nn)?;
    let definite = en.is_finite() && en * en < ee * nn;
    require("covariance_en_m2[1]", en, definite, "positive definite")?;
    let possible = fix.map_error_m.is_finite() && fix.map_error_m >= 0.0;
    require(
        "map_error_m",
        fix.map_error_m,
        possible,
        "finite and not negative",
    )?;
    if let Some(heading_deg) = fix.heading_deg {
        finite("heading_deg", heading_deg)?;
    }
    positive("gsd_m", fix.gsd_m)?;
    let probability = (0.0..=1.0).contains(&fix.confidence);
    require("confidence", fix.confidence, probability, "in [0, 1]")
}

fn finite(field: &'static str, value: f64) -> Result<(), InputError> {
    require(field, value, value.is_finite(), "finite")
}

fn positive(field: &'static str, value: f64) -> Result<(), InputError> {
    let possible = value.is_finite() && value > 0.0;
    require(field, value, possible, "finite and above 0")
}

fn require(
    field: &'static str,
    value: f64,
    holds: bool,
    expected: &'static str,
) -> Result<(), InputError> {
    if holds {
        Ok(())
    } else {
        Err(InputError::Invalid {
            field,
            value,
            expected,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fix() -> PositionFix {
        PositionFix {
            time_s: 1.0,
            lonlat: LonLat::new(120.7, 24.2),
            covariance_en_m2: [1.0, 0.2, 2.0],
            map_error_m: 1.0,
            heading_deg: Some(10.0),
            gsd_m: 0.05,
            confidence: 0.9,
        }
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let bad = [
            (
                "lat_deg",
                PositionFix {
                    lonlat: LonLat::new(0.0, 91.0),
                    ..fix()
                },
            ),
            (
                "covariance_en_m2[1]",
                PositionFix {
                    covariance_en_m2: [1.0, 2.0, 1.0],
                    ..fix()
                },
            ),
            (
                "covariance_en_m2[0]",
                PositionFix {
                    covariance_en_m2: [f64::NAN, 0.0, 1.0],
                    ..fix()
                },
            ),
            (
                "map_error_m",
                PositionFix {
                    map_error_m: -1.0,
                    ..fix()
                },
            ),
            (
                "heading_deg",
                PositionFix {
                    heading_deg: Some(f64::INFINITY),
                    ..fix()
                },
            ),
            (
                "gsd_m",
                PositionFix {
                    gsd_m: 0.0,
                    ..fix()
                },
            ),
            (
                "confidence",
                PositionFix {
                    confidence: 1.1,
                    ..fix()
                },
            ),
            (
                "time_s",
                PositionFix {
                    time_s: f64::NAN,
                    ..fix()
                },
            ),
        ];
        for (name, fix) in bad {
            match Input::Fix(fix).validate() {
                Err(InputError::Invalid { field, .. }) => assert_eq!(field, name),
                other => panic!("{name}: {other:?}"),
            }
        }
        assert!(Input::Fix(fix()).validate().is_ok());
    }

    #[test]
    fn the_roll_of_a_gimbal_turns_the_photo_about_its_centre() {
        let level = Attitude::from_gimbal(0.0, 30.0, -80.0, 0.0);
        for (value, expected) in [
            (level.yaw_deg, 30.0),
            (level.pitch_deg, 10.0),
            (level.roll_deg, 0.0),
        ] {
            assert!((value - expected).abs() < 1e-9, "{level:?}");
        }
        // Straight down a roll is a turn of the photo, and the camera still looks straight down.
        let turned = Attitude::from_gimbal(0.0, 30.0, -90.0, 20.0);
        assert!((turned.yaw_deg - 50.0).abs() < 1e-9, "{turned:?}");
        assert!(turned.pitch_deg.abs() < 1e-9 && turned.roll_deg.abs() < 1e-9);
        // Tilted, the optical axis stays where it is.
        let axis = |a: Attitude| {
            Rotation3::from_euler_angles(
                a.roll_deg.to_radians(),
                a.pitch_deg.to_radians(),
                a.yaw_deg.to_radians(),
            ) * Vector3::z()
        };
        let rolled = Attitude::from_gimbal(0.0, 30.0, -80.0, 20.0);
        assert!((axis(rolled) - axis(level)).norm() < 1e-12);
    }

    #[test]
    fn inputs_of_one_time_have_one_order() {
        let attitude = Input::Attitude(Attitude {
            time_s: 1.0,
            yaw_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
        });
        let other = Input::Fix(PositionFix {
            confidence: 0.5,
            ..fix()
        });
        assert_eq!(attitude.order(&Input::Fix(fix())), Ordering::Less);
        assert_eq!(other.order(&Input::Fix(fix())), Ordering::Less);
        assert_eq!(Input::Fix(fix()).order(&Input::Fix(fix())), Ordering::Equal);
    }
}
