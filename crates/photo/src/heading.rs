//! Which heading and tilt are believed.

use crate::camera::{MAX_PITCH_FROM_NADIR_DEG, Tilt};
use crate::metadata::Metadata;
use crate::view::{Heading, HeadingSource, Overrides, View};

/// 1-sigma of a heading that the user gives, degrees.
const USER_SIGMA_DEG: f64 = 3.0;
/// 1-sigma of a gimbal's yaw, degrees: the compass of a small drone in flight.
const GIMBAL_SIGMA_DEG: f64 = 5.0;
/// 1-sigma of an aircraft's yaw taken for the camera's, degrees.
const FLIGHT_SIGMA_DEG: f64 = 10.0;
/// 1-sigma of EXIF's image direction, degrees.
const IMAGE_DIRECTION_SIGMA_DEG: f64 = 15.0;
/// Gimbal and aircraft this far apart may be a flip by 180 degrees, degrees.
const FLIP_DEG: f64 = 150.0;
/// Gimbals that do not pan follow the aircraft this closely, degrees.
const PAN_DEG: f64 = 30.0;
/// Tilts below this change less than heights do over a town, degrees.
const LEAST_TILT_DEG: f64 = 1.0;

/// How the camera was turned, as far as it is believed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Attitude {
    pub pitch_from_nadir_deg: f64,
    pub roll_deg: f64,
}

/// Fills the view's heading and gives the attitude that is believed, `None` for one that is not known.
pub(crate) fn resolve(
    metadata: &Metadata,
    overrides: &Overrides,
    view: &mut View,
) -> Option<Attitude> {
    let recorded = gimbal_is_recorded(metadata, view);
    let attitude = if recorded {
        attitude(metadata, view)
    } else {
        None
    };
    match overrides.heading {
        HeadingSource::Known(heading_deg) if heading_deg.is_finite() => {
            view.heading = Some(Heading {
                heading_deg: heading_deg.rem_euclid(360.0),
                sigma_deg: USER_SIGMA_DEG,
            });
            view.use_evidence("heading", degrees(heading_deg), "given by the user");
        }
        HeadingSource::Known(value) => {
            view.set_aside(
                "heading",
                value.to_string(),
                "given by the user, not a number",
            );
        }
        HeadingSource::Unknown => {
            for (field, value) in [
                ("gimbal yaw", metadata.gimbal_yaw_deg),
                ("flight yaw", metadata.flight_yaw_deg),
            ] {
                if let Some(value) = value.filter(|_| recorded || field == "flight yaw") {
                    view.set_aside(
                        field,
                        degrees(value),
                        "the user asked for an unknown heading",
                    );
                }
            }
        }
        HeadingSource::Exif => from_metadata(metadata, recorded, view),
    }
    attitude
}

/// Whether the gimbal's angles were recorded: all zero would be a camera that looks at the horizon, due north and
/// level to a hundredth of a degree, and is what drones write that do not record them.
fn gimbal_is_recorded(metadata: &Metadata, view: &mut View) -> bool {
    let angles = [
        metadata.gimbal_yaw_deg,
        metadata.gimbal_pitch_deg,
        metadata.gimbal_roll_deg,
    ];
    if angles.iter().all(Option::is_none) {
        return false;
    }
    if angles.iter().flatten().all(|&angle| angle == 0.0) {
        view.set_aside(
            "gimbal yaw, pitch, roll",
            "0, 0, 0 deg",
            "all exactly zero: not recorded, rather than a level camera looking north at the horizon",
        );
        return false;
    }
    true
}

fn attitude(metadata: &Metadata, view: &mut View) -> Option<Attitude> {
    let pitch = metadata.gimbal_pitch_deg?;
    if pitch == 0.0 {
        view.set_aside(
            "gimbal pitch",
            "0 deg",
            "exactly zero: not recorded, rather than a camera looking at the horizon",
        );
        return None;
    }
    let pitch_from_nadir_deg = pitch + 90.0;
    let roll_deg = metadata.gimbal_roll_deg.unwrap_or(0.0);
    if !(-MAX_PITCH_FROM_NADIR_DEG..=MAX_PITCH_FROM_NADIR_DEG).contains(&pitch_from_nadir_deg) {
        view.set_aside(
            "gimbal pitch",
            degrees(pitch),
            format!(
                "{:.0} degrees off straight down: the picture's centre shows no usable ground, if that is true",
                pitch_from_nadir_deg.abs()
            ),
        );
        return None;
    }
    if metadata.orientation != 1 && pitch_from_nadir_deg.abs() >= LEAST_TILT_DEG {
        view.set_aside(
            "gimbal pitch",
            degrees(pitch),
            "the picture is stored turned, so which of its sides is the far one is not certain",
        );
        return None;
    }
    if pitch_from_nadir_deg.abs() >= LEAST_TILT_DEG {
        view.use_evidence(
            "gimbal pitch",
            degrees(pitch),
            format!("looks {pitch_from_nadir_deg:.1} degrees off straight down; rectified"),
        );
    } else {
        view.use_evidence("gimbal pitch", degrees(pitch), "straight down");
    }
    Some(Attitude {
        pitch_from_nadir_deg,
        roll_deg,
    })
}

impl Attitude {
    /// The rectification that this attitude asks for, if any.
    pub(crate) fn tilt(self, hfov_deg: f64) -> Option<Tilt> {
        (self.pitch_from_nadir_deg.abs() >= LEAST_TILT_DEG).then_some(Tilt {
            pitch_from_nadir_deg: self.pitch_from_nadir_deg,
            roll_deg: self.roll_deg,
            hfov_deg,
        })
    }
}

fn from_metadata(metadata: &Metadata, recorded: bool, view: &mut View) {
    let flight_yaw = metadata
        .flight_yaw_deg
        .filter(|_| flight_is_recorded(metadata, view));
    let turn = orientation_turn_deg(metadata.orientation);
    if let Some(yaw) = metadata.gimbal_yaw_deg.filter(|_| recorded) {
        let pitch_from_nadir = metadata.gimbal_pitch_deg.map_or(0.0, |pitch| pitch + 90.0);
        let roll = metadata.gimbal_roll_deg.unwrap_or(0.0);
        let top = if pitch_from_nadir.abs() < MAX_PITCH_FROM_NADIR_DEG {
            yaw + Tilt::top_from_yaw_deg(pitch_from_nadir, roll)
        } else {
            yaw
        };
        let apart = flight_yaw.map_or(0.0, |flight| difference_deg(top, flight).abs());
        if apart > FLIP_DEG {
            let reason = format!(
                "gimbal and aircraft point {apart:.0} degrees apart: one of them may be flipped, so neither is believed"
            );
            view.set_aside("gimbal yaw", degrees(yaw), reason.clone());
            if let Some(flight) = flight_yaw {
                view.set_aside("flight yaw", degrees(flight), reason);
            }
            return;
        }
        let mut sigma_deg = GIMBAL_SIGMA_DEG;
        let mut reason = String::from("the gimbal's yaw is the camera's");
        if apart > PAN_DEG {
            sigma_deg = FLIGHT_SIGMA_DEG;
            reason.push_str(&format!(
                "; doubtful, {apart:.0} degrees from the aircraft's"
            ));
        }
        if turn != 0.0 {
            sigma_deg = sigma_deg.max(FLIGHT_SIGMA_DEG);
            reason.push_str("; turned with the picture by EXIF orientation");
        }
        if let Some(flight) = flight_yaw {
            view.set_aside(
                "flight yaw",
                degrees(flight),
                "the gimbal's yaw is there and is the camera's",
            );
        }
        view.use_evidence("gimbal yaw", degrees(yaw), reason);
        view.heading = Some(Heading {
            heading_deg: (top + turn).rem_euclid(360.0),
            sigma_deg,
        });
    } else if let Some(yaw) = flight_yaw {
        view.use_evidence(
            "flight yaw",
            degrees(yaw),
            "doubtful: the aircraft's heading, taken for the camera's because the gimbal's is not recorded",
        );
        view.heading = Some(Heading {
            heading_deg: (yaw + turn).rem_euclid(360.0),
            sigma_deg: FLIGHT_SIGMA_DEG,
        });
    } else if let Some(direction) = metadata.image_direction {
        let mut reason = String::from("doubtful: EXIF image direction");
        if direction.magnetic {
            reason.push_str(", counted from magnetic north (declination not applied)");
        }
        view.use_evidence("GPSImgDirection", degrees(direction.bearing_deg), reason);
        view.heading = Some(Heading {
            heading_deg: (direction.bearing_deg + turn).rem_euclid(360.0),
            sigma_deg: IMAGE_DIRECTION_SIGMA_DEG,
        });
    }
}

/// An aircraft whose yaw, pitch and roll are all exactly zero was not measured.
fn flight_is_recorded(metadata: &Metadata, view: &mut View) -> bool {
    let angles = [
        metadata.flight_yaw_deg,
        metadata.flight_pitch_deg,
        metadata.flight_roll_deg,
    ];
    let recorded = angles.iter().flatten().any(|&angle| angle != 0.0);
    if !recorded && metadata.flight_yaw_deg.is_some() {
        view.set_aside(
            "flight yaw",
            "0 deg",
            "the aircraft's angles are all exactly zero: not recorded",
        );
    }
    recorded
}

/// How far the top of the displayed picture lies clockwise of the top of the stored one, degrees on the ground.
///
/// Orientation 6 turns the stored picture clockwise by 90 degrees for display, so its left edge comes to the top.
fn orientation_turn_deg(orientation: u8) -> f64 {
    match orientation {
        3 | 4 => 180.0,
        5 | 6 => -90.0,
        7 | 8 => 90.0,
        _ => 0.0,
    }
}

/// `a - b` as a turn between -180 and 180 degrees.
fn difference_deg(a: f64, b: f64) -> f64 {
    (a - b + 180.0).rem_euclid(360.0) - 180.0
}

fn degrees(value: f64) -> String {
    format!("{value} deg")
}
