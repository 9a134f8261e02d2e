//! Which field of view, height and ground width are used.

use crate::camera::{EquivalentFocal, focal_px, focal_px_from_35mm, fov_deg};
use crate::metadata::{Metadata, SAME_ASPECT};
use crate::view::{CameraAttitude, Footprint, View, ViewPrior};

/// Relative 1-sigma of a ground resolution or height that the caller gives.
const USER_SIGMA: f64 = 0.02;
/// Relative 1-sigma of a calibrated focal length.
const CALIBRATED_SIGMA: f64 = 0.01;
/// Relative 1-sigma of a focal length from the pixel density of the sensor.
const FOCAL_PLANE_SIGMA: f64 = 0.05;
/// Relative 1-sigma of a height above ground that the drone measured.
const ABOVE_GROUND_SIGMA: f64 = 0.1;
/// Relative 1-sigma of the height above the take-off point used as height above ground: terrain is uneven and barometers drift.
/// On a flight over a flat town it was 10 % too large.
const RELATIVE_ALTITUDE_SIGMA: f64 = 0.15;
/// EXIF's name of the pixel density of the sensor.
const FOCAL_PLANE: &str = "FocalPlaneXResolution";
/// Two focal lengths of one photo that differ by more than this share contradict each other.
const FOCAL_AGREEMENT: f64 = 0.1;
/// Metres of ground per pixel of a photo: from 2 m with a long lens, and to 20 km in a picture of few pixels, with room to spare.
pub const PHOTO_GSD_RANGE_M: std::ops::RangeInclusive<f64> = 1e-5..=1e3;
/// Plausible heights above ground, m.
pub const HEIGHT_AGL_RANGE_M: std::ops::RangeInclusive<f64> = 2.0..=20_000.0;
/// Plausible fields of view of cameras without a fisheye lens, degrees.
pub const HFOV_RANGE_DEG: std::ops::RangeInclusive<f64> = 1.0..=150.0;

/// A number with its relative 1-sigma.
#[derive(Debug, Clone, Copy)]
struct Uncertain {
    value: f64,
    relative_sigma: f64,
}

/// Sets the view's field of view, height, tilt and ground width. `size_px` is the size of the displayed picture.
pub(crate) fn resolve(
    metadata: &Metadata,
    size_px: (u32, u32),
    prior: &ViewPrior,
    attitude: Option<CameraAttitude>,
    view: &mut View,
) {
    let focal = focal(metadata, size_px, prior, view);
    let hfov_deg = focal.map(|focal| fov_deg(f64::from(size_px.0), focal.value));
    view.hfov_deg = hfov_deg;
    view.tilt = attitude
        .zip(hfov_deg)
        .and_then(|(attitude, hfov_deg)| attitude.tilt(hfov_deg));
    if let Some(gsd_m) = prior.gsd_m {
        if gsd_m.is_finite() && gsd_m > 0.0 {
            view.use_evidence("gsd", format!("{gsd_m} m/px"), "given by the caller");
            view.footprint = Some(Footprint {
                width_m: gsd_m * f64::from(size_px.0),
                relative_sigma: USER_SIGMA,
            });
            let reason = "overridden by the ground resolution that the caller gave";
            for (field, value) in [
                ("height above ground", prior.height_agl_m),
                ("AboveGroundAltitude", metadata.above_ground_m),
                ("RelativeAltitude", metadata.relative_altitude_m),
            ] {
                if let Some(value) = value {
                    view.set_aside(field, metres(value), reason);
                }
            }
            return;
        }
        view.set_aside(
            "gsd",
            gsd_m.to_string(),
            "given by the caller, but not a positive number",
        );
    }
    let Some(height) = height(metadata, prior, focal.is_some(), view) else {
        return;
    };
    view.height_agl_m = Some(height.value);
    if let Some(focal) = focal {
        let slant = view
            .tilt
            .map_or(1.0, |tilt| tilt.pitch_from_nadir_deg.to_radians().cos());
        view.footprint = Some(Footprint {
            width_m: f64::from(size_px.0) / focal.value * height.value / slant,
            relative_sigma: height.relative_sigma.hypot(focal.relative_sigma),
        });
    }
}

/// Height above ground. It is stated as used where the field of view is known, without which it tells no ground width.
fn height(
    metadata: &Metadata,
    prior: &ViewPrior,
    has_focal: bool,
    view: &mut View,
) -> Option<Uncertain> {
    if let Some(altitude) = metadata.gps_altitude_m {
        view.set_aside(
            "GPS altitude",
            metres(altitude),
            "altitude above sea level is never used as height above ground",
        );
    }
    let mut found = None;
    let candidates = [
        (
            "height above ground",
            prior.height_agl_m,
            USER_SIGMA,
            "given by the caller",
        ),
        (
            "AboveGroundAltitude",
            metadata.above_ground_m,
            ABOVE_GROUND_SIGMA,
            "height above ground recorded by the drone",
        ),
        (
            "RelativeAltitude",
            metadata.relative_altitude_m,
            RELATIVE_ALTITUDE_SIGMA,
            "height above the take-off point, used as height above ground with 15 % uncertainty",
        ),
    ];
    for (field, value, relative_sigma, reason) in candidates {
        let Some(value) = value else { continue };
        if !HEIGHT_AGL_RANGE_M.contains(&value) {
            let reason = format!(
                "out of range: a height above ground must be between {} and {} m",
                HEIGHT_AGL_RANGE_M.start(),
                HEIGHT_AGL_RANGE_M.end()
            );
            view.set_aside(field, metres(value), reason);
        } else if found.is_some() {
            view.set_aside(field, metres(value), "a better height is available");
        } else {
            if has_focal {
                view.use_evidence(field, metres(value), reason);
            } else {
                let reason = "without a field of view (hfov) it does not tell the ground width";
                view.set_aside(field, metres(value), reason);
            }
            found = Some(Uncertain {
                value,
                relative_sigma,
            });
        }
    }
    found
}

/// Focal length in pixels of the photo at full size.
fn focal(
    metadata: &Metadata,
    size_px: (u32, u32),
    prior: &ViewPrior,
    view: &mut View,
) -> Option<Uncertain> {
    if let Some(hfov_deg) = prior.hfov_deg {
        if HFOV_RANGE_DEG.contains(&hfov_deg) {
            view.use_evidence("hfov", format!("{hfov_deg} deg"), "given by the caller");
            let reason = "overridden by the field of view that the caller gave";
            set_focal_lengths_aside(metadata, reason, view);
            return Some(Uncertain {
                value: focal_px(f64::from(size_px.0), hfov_deg),
                relative_sigma: USER_SIGMA,
            });
        }
        view.set_aside(
            "hfov",
            hfov_deg.to_string(),
            "given by the caller, but not between 1 and 150 degrees",
        );
    }
    let stored_px = metadata.stored_px(size_px);
    let original_px = match metadata.original_size_px {
        Some((width, height)) if metadata.was_turned(stored_px) => (height, width),
        Some(original_px) => original_px,
        None => stored_px,
    };
    let file_from_original = match resized_by(stored_px, original_px) {
        Some(factor) => factor,
        None => {
            let reason = format!(
                "the camera stored {} x {} px, but the file has {} x {} px: cropped by an unknown amount",
                original_px.0, original_px.1, stored_px.0, stored_px.1
            );
            set_focal_lengths_aside(metadata, &reason, view);
            return None;
        }
    };
    if let Some(zoom) = metadata.digital_zoom.filter(|zoom| *zoom > 1.01) {
        let reason = "digital zoom: manufacturers differ in whether focal lengths include it, so no focal length is used";
        view.set_aside("DigitalZoomRatio", zoom.to_string(), reason);
        set_focal_lengths_aside(metadata, reason, view);
        return None;
    }
    focal_of_original(metadata, original_px, view).map(|focal| Uncertain {
        value: focal.value * file_from_original,
        ..focal
    })
}

fn set_focal_lengths_aside(metadata: &Metadata, reason: &str, view: &mut View) {
    for (field, value, unit) in [
        ("CalibratedFocalLength", metadata.calibrated_focal_px, "px"),
        ("FocalLengthIn35mmFilm", metadata.focal_35mm, "mm"),
        (FOCAL_PLANE, metadata.focal_plane_px.map(f64::round), "px"),
    ] {
        if let Some(value) = value {
            view.set_aside(field, format!("{value} {unit}"), reason);
        }
    }
}

/// Ratio of the file's size to the size that the camera stored; `None` if their aspect ratios differ.
fn resized_by(stored_px: (u32, u32), original_px: (u32, u32)) -> Option<f64> {
    let across = f64::from(stored_px.0) / f64::from(original_px.0);
    let down = f64::from(stored_px.1) / f64::from(original_px.1);
    ((across / down - 1.0).abs() < SAME_ASPECT).then_some(across)
}

fn focal_of_original(
    metadata: &Metadata,
    original_px: (u32, u32),
    view: &mut View,
) -> Option<Uncertain> {
    let equivalent = metadata
        .focal_35mm
        .and_then(|focal_35mm| focal_px_from_35mm(focal_35mm, original_px));
    if let (Some(focal_35mm), None) = (metadata.focal_35mm, &equivalent) {
        view.set_aside(
            "FocalLengthIn35mmFilm",
            format!("{focal_35mm} mm"),
            "the aspect ratio is none for which its convention is known, 4:3, 3:2 or 16:9 (a panorama, a crop or a thermal picture)",
        );
    }
    if let Some(calibrated) = metadata.calibrated_focal_px {
        let agrees = equivalent
            .as_ref()
            .is_none_or(|e| (calibrated / e.focal_px - 1.0).abs() <= FOCAL_AGREEMENT);
        let fov = fov_deg(f64::from(original_px.0.max(original_px.1)), calibrated);
        if agrees && HFOV_RANGE_DEG.contains(&fov) {
            view.use_evidence(
                "CalibratedFocalLength",
                format!("{calibrated} px"),
                format!(
                    "calibrated, for the full image width of {} px",
                    original_px.0
                ),
            );
            if let Some(focal_35mm) = metadata.focal_35mm.filter(|_| equivalent.is_some()) {
                view.set_aside(
                    "FocalLengthIn35mmFilm",
                    format!("{focal_35mm} mm"),
                    "agrees with the calibrated focal length, which is more accurate",
                );
            }
            return Some(Uncertain {
                value: calibrated,
                relative_sigma: CALIBRATED_SIGMA,
            });
        }
        view.set_aside(
            "CalibratedFocalLength",
            format!("{calibrated} px"),
            "differs from the 35 mm equivalent by more than 10 %, or is implausible",
        );
    }
    if let (Some(focal_35mm), Some(equivalent)) = (metadata.focal_35mm, equivalent) {
        let EquivalentFocal {
            focal_px,
            relative_sigma,
            reading,
        } = equivalent;
        if HFOV_RANGE_DEG.contains(&fov_deg(f64::from(original_px.0), focal_px)) {
            view.use_evidence("FocalLengthIn35mmFilm", format!("{focal_35mm} mm"), reading);
            return Some(Uncertain {
                value: focal_px,
                relative_sigma,
            });
        }
        view.set_aside(
            "FocalLengthIn35mmFilm",
            format!("{focal_35mm} mm"),
            "implausible focal length",
        );
    }
    focal_of_sensor(metadata, original_px, view)
}

/// The focal length by the pixel density of the sensor.
fn focal_of_sensor(
    metadata: &Metadata,
    original_px: (u32, u32),
    view: &mut View,
) -> Option<Uncertain> {
    let focal_plane = metadata.focal_plane_px?;
    let value = format!("{focal_plane:.0} px");
    let fov = fov_deg(f64::from(original_px.0.max(original_px.1)), focal_plane);
    if !HFOV_RANGE_DEG.contains(&fov) {
        // Some cameras state the density in another unit than they say.
        view.set_aside(FOCAL_PLANE, value, "implausible focal length");
        return None;
    }
    let reason = "focal length from the pixel density of the sensor";
    view.use_evidence(FOCAL_PLANE, value, reason);
    Some(Uncertain {
        value: focal_plane,
        relative_sigma: FOCAL_PLANE_SIGMA,
    })
}

fn metres(value: f64) -> String {
    format!("{value} m")
}
