//! What the filter takes in, each with the time at which it was true (not the time at which it arrived).

use std::cmp::Ordering;
use std::ops::RangeInclusive;

use grimnet_geo::LonLat;
use serde::{Deserialize, Serialize};

use crate::attitude::Attitude;

/// Heights above ground that are taken, metres. Below them an aircraft stands; above them a height is in another unit or a mark for none,
/// such as 65535.
pub const HEIGHT_AGL_RANGE_M: RangeInclusive<f64> = 1.0..=20_000.0;

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
    /// Random error of the displacement, pixels, 1 sigma per axis. That of the attitude is not in it: the filter knows how it changes.
    pub sigma_px: f64,
    /// By how much the surface that is seen may itself have moved between the frames, pixels per axis, 1 sigma, alike for
    /// neighbouring frames: 0 over ground that the map shows. `None`: nothing tells that it is ground and not water, whose waves
    /// move by metres a second and repeat; the turn alone is then used.
    #[serde(default = "ground")]
    pub surface_sigma_px: Option<f64>,
}

/// The surface of motions that were recorded without one.
fn ground() -> Option<f64> {
    Some(0.0)
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

impl Height {
    /// A height says nothing of a photo that is further away in time than this, seconds.
    pub const HOLD_S: f64 = 10.0;
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

    /// Whether it was found in a frame of the camera.
    pub(crate) fn is_of_frame(&self) -> bool {
        matches!(self, Self::Motion(_) | Self::Fix(_) | Self::Miss(_))
    }

    /// The same input so many seconds later.
    #[must_use]
    pub fn moved_in_time(mut self, by_s: f64) -> Self {
        match &mut self {
            Self::Attitude(input) => input.time_s += by_s,
            Self::Height(input) => input.time_s += by_s,
            Self::Velocity(input) => input.time_s += by_s,
            Self::Motion(input) => {
                input.from_time_s += by_s;
                input.time_s += by_s;
            }
            Self::Fix(input) => input.time_s += by_s,
            Self::Miss(input) => input.time_s += by_s,
        }
        self
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
                m.surface_sigma_px.unwrap_or(f64::NAN),
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
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A fix that is taken.
    pub(crate) fn fix() -> PositionFix {
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
