//! Which heading and tilt are used.

use crate::camera::{MAX_PITCH_FROM_NADIR_DEG, Tilt};
use crate::metadata::{ImageDirection, Metadata};
use crate::nadir_angles::from_nadir_angles;
use crate::view::{
    CameraAttitude, HEADING_RANGE_DEG, Heading, HeadingPrior, PITCH_RANGE_DEG, ROLL_RANGE_DEG,
    View, ViewPrior,
};

/// 1-sigma of a gimbal's yaw, degrees: typical for the compass of a small drone in flight.
const GIMBAL_SIGMA_DEG: f64 = 5.0;
/// 1-sigma of an aircraft's yaw used as the camera's, degrees.
const FLIGHT_SIGMA_DEG: f64 = 10.0;
/// 1-sigma of EXIF's image direction, degrees.
const IMAGE_DIRECTION_SIGMA_DEG: f64 = 15.0;
/// If gimbal and aircraft yaw differ by more than this, one of them may be flipped by 180 degrees.
const FLIP_DEG: f64 = 150.0;
/// The yaw of a gimbal that does not pan differs from the aircraft's by less than this, degrees.
const PAN_DEG: f64 = 30.0;
/// Smaller tilts are ignored: they distort less than buildings do, degrees.
const MIN_TILT_DEG: f64 = 1.0;

/// Why the angles of a picture that was turned say nothing of it.
const TURNED: &str = "the picture was turned by a quarter after it was taken (its width and height are exchanged), in an \
                      unknown direction";

/// Name of the pitch that the caller gave.
const GIVEN_PITCH: &str = "pitch";

/// What is said of a yaw besides where EXIF orientation turns the stored picture.
const TURNED_BY_ORIENTATION: &str = "; rotated with the image by EXIF orientation";

/// Sets the view's heading. Returns the attitude, `None` if it is unknown. `size_px` is the size of the displayed picture.
pub(crate) fn resolve(
    metadata: &Metadata,
    size_px: (u32, u32),
    prior: &ViewPrior,
    view: &mut View,
) -> Option<CameraAttitude> {
    let recorded = gimbal_is_recorded(metadata, view);
    let turned = metadata.was_turned(metadata.stored_px(size_px));
    let given = given_attitude(prior, view);
    let attitude = match metadata.gimbal_pitch_deg.filter(|_| recorded) {
        Some(pitch) if given.is_some() => {
            let reason = "overridden by the pitch that the caller gave";
            view.set_aside("gimbal pitch", degrees(pitch), reason);
            given
        }
        Some(pitch) if turned => {
            view.set_aside("gimbal pitch", degrees(pitch), TURNED);
            None
        }
        Some(pitch) => attitude(metadata, pitch, view),
        None => given,
    };
    match prior.heading {
        HeadingPrior::Known {
            heading_deg,
            sigma_deg,
        } if HEADING_RANGE_DEG.contains(&heading_deg) && sigma_deg.is_finite() => {
            view.heading = Some(Heading {
                heading_deg: heading_deg.rem_euclid(360.0),
                sigma_deg,
            });
            view.use_evidence("heading", degrees(heading_deg), "given by the caller");
            let reason = "overridden by the heading that the caller gave";
            set_yaws_aside(metadata, recorded, reason, view);
        }
        HeadingPrior::Known {
            heading_deg,
            sigma_deg,
        } => {
            view.set_aside(
                "heading",
                format!("{heading_deg} +- {sigma_deg}"),
                "given by the caller, but not degrees from -720 to 720 with a finite sigma",
            );
        }
        HeadingPrior::Unknown => {
            let reason = "the caller asked to treat the heading as unknown";
            set_yaws_aside(metadata, recorded, reason, view);
        }
        HeadingPrior::FromMetadata if turned => {
            set_yaws_aside(metadata, recorded, TURNED, view);
        }
        HeadingPrior::FromMetadata => from_metadata(metadata, recorded, given, view),
    }
    attitude
}

/// The attitude of the pitch that the caller gave.
fn given_attitude(prior: &ViewPrior, view: &mut View) -> Option<CameraAttitude> {
    let pitch = prior.pitch_deg?;
    if prior.usable_pitch_deg().is_none() {
        let reason = format!(
            "given by the caller, but not degrees from {} to {}",
            PITCH_RANGE_DEG.start(),
            PITCH_RANGE_DEG.end()
        );
        view.set_aside(GIVEN_PITCH, pitch.to_string(), reason);
        return None;
    }
    let roll_deg = prior.roll_deg.filter(|roll| ROLL_RANGE_DEG.contains(roll));
    Some(CameraAttitude {
        pitch_from_nadir_deg: pitch + 90.0,
        roll_deg: roll_deg.unwrap_or(0.0),
    })
}

fn set_yaws_aside(metadata: &Metadata, gimbal_is_recorded: bool, reason: &str, view: &mut View) {
    let gimbal_yaw = metadata.gimbal_yaw_deg.filter(|_| gimbal_is_recorded);
    for (field, value) in [
        ("gimbal yaw", gimbal_yaw),
        ("flight yaw", metadata.flight_yaw_deg),
        (IMAGE_DIRECTION, image_direction_deg(metadata)),
    ] {
        if let Some(value) = value {
            view.set_aside(field, degrees(value), reason);
        }
    }
}

/// EXIF's name of the image direction.
const IMAGE_DIRECTION: &str = "GPSImgDirection";

fn image_direction_deg(metadata: &Metadata) -> Option<f64> {
    Some(metadata.image_direction?.bearing_deg)
}

/// Whether the gimbal's angles were recorded. Drones that do not record them write zeros; a camera that really has all angles
/// zero would look at the horizon, due north and level to a hundredth of a degree.
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
            "all exactly zero, so probably not recorded",
        );
        return false;
    }
    true
}

fn attitude(metadata: &Metadata, pitch: f64, view: &mut View) -> Option<CameraAttitude> {
    if pitch == 0.0 {
        view.set_aside(
            "gimbal pitch",
            "0 deg",
            "exactly zero, so probably not recorded",
        );
        return None;
    }
    let (attitude, _) = camera_angles(metadata);
    let pitch_from_nadir_deg = attitude.pitch_from_nadir_deg;
    if !(-MAX_PITCH_FROM_NADIR_DEG..=MAX_PITCH_FROM_NADIR_DEG).contains(&pitch_from_nadir_deg) {
        view.set_aside(
            "gimbal pitch",
            degrees(pitch),
            format!(
                "{:.0} degrees from nadir: too oblique, the image centre would show no usable ground",
                pitch_from_nadir_deg.abs()
            ),
        );
        return None;
    }
    if metadata.is_stored_turned() && pitch_from_nadir_deg.abs() >= MIN_TILT_DEG {
        view.set_aside(
            "gimbal pitch",
            degrees(pitch),
            "the image is stored rotated, so it is not certain which side is the far one",
        );
        return None;
    }
    Some(attitude)
}

/// States what the pitch is used for, once it is known whether the field of view is: without one no tilt is rectified.
pub(crate) fn state_pitch(metadata: &Metadata, prior: &ViewPrior, view: &mut View) {
    let given = prior.usable_pitch_deg();
    let (field, from, pitch) = match (given, metadata.gimbal_pitch_deg) {
        (Some(pitch), _) => (GIVEN_PITCH, "given by the caller: ", pitch),
        (None, Some(pitch)) => ("gimbal pitch", "", pitch),
        (None, None) => return,
    };
    let Some(attitude) = view.attitude else {
        return;
    };
    let from_nadir_deg = attitude.pitch_from_nadir_deg;
    if from_nadir_deg.abs() < MIN_TILT_DEG {
        view.use_evidence(field, degrees(pitch), format!("{from}nadir"));
    } else if view.tilt.is_some() {
        let reason = format!("{from}{from_nadir_deg:.1} degrees from nadir; rectified");
        view.use_evidence(field, degrees(pitch), reason);
    } else {
        let reason = format!(
            "{from}{from_nadir_deg:.1} degrees from nadir; not rectified, because the field of view (hfov) is unknown"
        );
        view.set_aside(field, degrees(pitch), reason);
    }
}

/// The camera's angles, and the bearing of its picture's top relative to its recorded yaw, degrees clockwise. Where no pitch is
/// recorded it is taken to look straight down.
fn camera_angles(metadata: &Metadata) -> (CameraAttitude, f64) {
    let pitch_from_nadir_deg = metadata.gimbal_pitch_deg.map_or(0.0, |pitch| pitch + 90.0);
    if let Some(roll_deg) = metadata.nadir_roll_deg {
        return from_nadir_angles(pitch_from_nadir_deg, roll_deg);
    }
    let attitude = CameraAttitude {
        pitch_from_nadir_deg,
        roll_deg: metadata.gimbal_roll_deg.unwrap_or(0.0),
    };
    let top_deg = Tilt::top_from_yaw_deg(pitch_from_nadir_deg, attitude.roll_deg);
    (attitude, top_deg)
}

impl CameraAttitude {
    /// The tilt to rectify, if it is large enough.
    pub(crate) fn tilt(self, hfov_deg: f64) -> Option<Tilt> {
        (self.pitch_from_nadir_deg.abs() >= MIN_TILT_DEG).then_some(Tilt {
            pitch_from_nadir_deg: self.pitch_from_nadir_deg,
            roll_deg: self.roll_deg,
            hfov_deg,
        })
    }
}

fn from_metadata(
    metadata: &Metadata,
    recorded: bool,
    given: Option<CameraAttitude>,
    view: &mut View,
) {
    let flight_yaw = metadata
        .flight_yaw_deg
        .filter(|_| flight_is_recorded(metadata, view));
    let turn = orientation_turn_deg(metadata.orientation);
    let gimbal_yaw = metadata.gimbal_yaw_deg.filter(|_| recorded);
    if let Some(bearing) = image_direction_deg(metadata)
        && (gimbal_yaw.is_some() || flight_yaw.is_some())
    {
        let reason = "a yaw is recorded, which is more accurate";
        view.set_aside(IMAGE_DIRECTION, degrees(bearing), reason);
    }
    if let Some(yaw) = gimbal_yaw {
        let (attitude, top_from_yaw_deg) =
            given.map_or_else(|| camera_angles(metadata), |given| (given, 0.0));
        let top = if attitude.pitch_from_nadir_deg.abs() < MAX_PITCH_FROM_NADIR_DEG {
            yaw + top_from_yaw_deg
        } else {
            yaw
        };
        let apart = flight_yaw.map_or(0.0, |flight| difference_deg(top, flight).abs());
        if apart > FLIP_DEG {
            let reason = format!(
                "gimbal and aircraft yaw differ by {apart:.0} degrees: one of them may be flipped, so neither is used"
            );
            view.set_aside("gimbal yaw", degrees(yaw), reason.clone());
            if let Some(flight) = flight_yaw {
                view.set_aside("flight yaw", degrees(flight), reason);
            }
            return;
        }
        let mut sigma_deg = GIMBAL_SIGMA_DEG;
        let mut reason = String::from("gimbal yaw is the yaw of the camera");
        if apart > PAN_DEG {
            sigma_deg = FLIGHT_SIGMA_DEG;
            reason.push_str(&format!(
                "; uncertain, {apart:.0} degrees from the aircraft's yaw"
            ));
        }
        if turn != 0.0 {
            sigma_deg = sigma_deg.max(FLIGHT_SIGMA_DEG);
            reason.push_str(TURNED_BY_ORIENTATION);
        }
        if let Some(flight) = flight_yaw {
            view.set_aside(
                "flight yaw",
                degrees(flight),
                "gimbal yaw is available and preferred",
            );
        }
        view.use_evidence("gimbal yaw", degrees(yaw), reason);
        view.heading = Some(Heading {
            heading_deg: (top + turn).rem_euclid(360.0),
            sigma_deg,
        });
    } else if let Some(yaw) = flight_yaw {
        let mut reason =
            String::from("uncertain: yaw of the aircraft, used because no gimbal yaw is recorded");
        if turn != 0.0 {
            reason.push_str(TURNED_BY_ORIENTATION);
        }
        view.use_evidence("flight yaw", degrees(yaw), reason);
        view.heading = Some(Heading {
            heading_deg: (yaw + turn).rem_euclid(360.0),
            sigma_deg: FLIGHT_SIGMA_DEG,
        });
    } else if let Some(direction) = metadata.image_direction {
        from_image_direction(direction, view);
    }
}

fn from_image_direction(direction: ImageDirection, view: &mut View) {
    let mut reason = String::from("uncertain: EXIF image direction");
    if direction.magnetic {
        reason.push_str(", relative to magnetic north (declination not applied)");
    }
    view.use_evidence(IMAGE_DIRECTION, degrees(direction.bearing_deg), reason);
    view.heading = Some(Heading {
        // Where the camera looks: cameras choose the orientation so that this is up in the displayed picture.
        heading_deg: direction.bearing_deg.rem_euclid(360.0),
        sigma_deg: IMAGE_DIRECTION_SIGMA_DEG,
    });
}

/// Whether the aircraft's angles were recorded: not if they are all exactly zero.
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
            "all angles of the aircraft are exactly zero, so probably not recorded",
        );
    }
    recorded
}

/// Bearing of the displayed picture's top relative to the stored picture's top, degrees clockwise.
///
/// Orientation 6 turns the stored picture clockwise by 90 degrees for display, so its left edge comes to the top. 5 and 7 are
/// stored mirrored: their edges lie on the other side of the stored top.
fn orientation_turn_deg(orientation: u8) -> f64 {
    match orientation {
        3 | 4 => 180.0,
        6 | 7 => -90.0,
        5 | 8 => 90.0,
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
