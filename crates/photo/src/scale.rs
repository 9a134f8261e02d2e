//! Which field of view, height and ground width are believed.

use crate::camera::{EquivalentFocal, focal_px, focal_px_from_35mm, fov_deg};
use crate::heading::Attitude;
use crate::metadata::Metadata;
use crate::view::{Footprint, Overrides, View};

/// Relative 1-sigma of what the user gives as metres per pixel or height.
const USER_SIGMA: f64 = 0.02;
/// Relative 1-sigma of a calibrated focal length.
const CALIBRATED_SIGMA: f64 = 0.01;
/// Relative 1-sigma of a focal length by the density of pixels on the sensor.
const FOCAL_PLANE_SIGMA: f64 = 0.05;
/// Relative 1-sigma of a height above ground that the drone measured.
const ABOVE_GROUND_SIGMA: f64 = 0.1;
/// Relative 1-sigma of the height above the take-off point as a height above ground: the ground rises and falls, and
/// barometers drift. On a flight over a flat town 10 % too much was measured.
const RELATIVE_ALTITUDE_SIGMA: f64 = 0.15;
/// Two focal lengths of one photo that differ by more than this share cannot both be right.
const FOCAL_AGREEMENT: f64 = 0.1;
/// Heights above ground that photos are taken from, m.
const HEIGHT_RANGE_M: std::ops::RangeInclusive<f64> = 2.0..=20_000.0;
/// Fields of view that cameras without a fisheye lens have, degrees.
const FOV_RANGE_DEG: std::ops::RangeInclusive<f64> = 1.0..=150.0;

/// A number with its relative 1-sigma.
#[derive(Debug, Clone, Copy)]
struct Uncertain {
    value: f64,
    relative_sigma: f64,
}

/// Fills the view's field of view, height, tilt and ground width.
pub(crate) fn resolve(
    metadata: &Metadata,
    size_px: (u32, u32),
    overrides: &Overrides,
    attitude: Option<Attitude>,
    view: &mut View,
) {
    let focal = focal(metadata, size_px, overrides, view);
    let hfov_deg = focal.map(|focal| fov_deg(f64::from(size_px.0), focal.value));
    view.hfov_deg = hfov_deg;
    view.tilt = attitude
        .zip(hfov_deg)
        .and_then(|(attitude, hfov_deg)| attitude.tilt(hfov_deg));
    if let Some(gsd_m) = overrides.gsd_m {
        if gsd_m.is_finite() && gsd_m > 0.0 {
            view.use_evidence("gsd", format!("{gsd_m} m/px"), "given by the user");
            view.footprint = Some(Footprint {
                width_m: gsd_m * f64::from(size_px.0),
                relative_sigma: USER_SIGMA,
            });
            if let Some(relative) = metadata.relative_altitude_m {
                view.set_aside(
                    "RelativeAltitude",
                    metres(relative),
                    "the user gave metres per pixel",
                );
            }
            return;
        }
        view.set_aside(
            "gsd",
            gsd_m.to_string(),
            "given by the user, not a ground resolution",
        );
    }
    let Some(height) = height(metadata, overrides, view) else {
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

fn height(metadata: &Metadata, overrides: &Overrides, view: &mut View) -> Option<Uncertain> {
    if let Some(altitude) = metadata.gps_altitude_m {
        view.set_aside(
            "GPS altitude",
            metres(altitude),
            "height above the sea, never taken for height above ground",
        );
    }
    let mut found = None;
    let candidates = [
        (
            "height above ground",
            overrides.height_agl_m,
            USER_SIGMA,
            "given by the user",
        ),
        (
            "AboveGroundAltitude",
            metadata.above_ground_m,
            ABOVE_GROUND_SIGMA,
            "height above ground as the drone had it",
        ),
        (
            "RelativeAltitude",
            metadata.relative_altitude_m,
            RELATIVE_ALTITUDE_SIGMA,
            "doubtful by 15 %: height above the take-off point, taken for height above ground",
        ),
    ];
    for (field, value, relative_sigma, reason) in candidates {
        let Some(value) = value else { continue };
        if !HEIGHT_RANGE_M.contains(&value) {
            let reason = format!(
                "not a height above ground between {} and {} m",
                HEIGHT_RANGE_M.start(),
                HEIGHT_RANGE_M.end()
            );
            view.set_aside(field, metres(value), reason);
        } else if found.is_some() {
            view.set_aside(field, metres(value), "a better height is there");
        } else {
            view.use_evidence(field, metres(value), reason);
            found = Some(Uncertain {
                value,
                relative_sigma,
            });
        }
    }
    found
}

/// Focal length in pixels of the photo file.
fn focal(
    metadata: &Metadata,
    size_px: (u32, u32),
    overrides: &Overrides,
    view: &mut View,
) -> Option<Uncertain> {
    if let Some(hfov_deg) = overrides.hfov_deg {
        if FOV_RANGE_DEG.contains(&hfov_deg) {
            view.use_evidence("hfov", format!("{hfov_deg} deg"), "given by the user");
            return Some(Uncertain {
                value: focal_px(f64::from(size_px.0), hfov_deg),
                relative_sigma: USER_SIGMA,
            });
        }
        view.set_aside(
            "hfov",
            hfov_deg.to_string(),
            "given by the user, not a field of view between 1 and 150 degrees",
        );
    }
    let stored_px = if metadata.swaps_sides() {
        (size_px.1, size_px.0)
    } else {
        size_px
    };
    let original_px = metadata.original_size_px.unwrap_or(stored_px);
    let file_from_original = match resized_by(stored_px, original_px) {
        Some(factor) => factor,
        None => {
            let values = [
                ("CalibratedFocalLength", metadata.calibrated_focal_px, "px"),
                ("FocalLengthIn35mmFilm", metadata.focal_35mm, "mm"),
            ];
            for (field, value, unit) in values {
                if let Some(value) = value {
                    let reason = format!(
                        "the camera stored {} x {} px, the file has {} x {}: it was cropped, by how much is not known",
                        original_px.0, original_px.1, stored_px.0, stored_px.1
                    );
                    view.set_aside(field, format!("{value} {unit}"), reason);
                }
            }
            return None;
        }
    };
    if let Some(zoom) = metadata.digital_zoom.filter(|zoom| *zoom > 1.01) {
        let reason = "digital zoom: whether the focal lengths include it differs by maker, so none is believed";
        view.set_aside("DigitalZoomRatio", zoom.to_string(), reason);
        return None;
    }
    focal_of_original(metadata, original_px, view).map(|focal| Uncertain {
        value: focal.value * file_from_original,
        ..focal
    })
}

/// The factor between a camera's picture and the file, `None` where their shapes differ.
fn resized_by(stored_px: (u32, u32), original_px: (u32, u32)) -> Option<f64> {
    let across = f64::from(stored_px.0) / f64::from(original_px.0);
    let down = f64::from(stored_px.1) / f64::from(original_px.1);
    ((across / down - 1.0).abs() < 0.01).then_some(across)
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
            "the picture has no sensor's shape (a panorama or a crop)",
        );
    }
    if let Some(calibrated) = metadata.calibrated_focal_px {
        let agrees = equivalent
            .as_ref()
            .is_none_or(|e| (calibrated / e.focal_px - 1.0).abs() <= FOCAL_AGREEMENT);
        let fov = fov_deg(f64::from(original_px.0.max(original_px.1)), calibrated);
        if agrees && FOV_RANGE_DEG.contains(&fov) {
            view.use_evidence(
                "CalibratedFocalLength",
                format!("{calibrated} px"),
                format!("calibrated, of the full picture {} px wide", original_px.0),
            );
            if let Some(focal_35mm) = metadata.focal_35mm.filter(|_| equivalent.is_some()) {
                view.set_aside(
                    "FocalLengthIn35mmFilm",
                    format!("{focal_35mm} mm"),
                    "agrees with the calibrated focal length, which is finer",
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
            "contradicts the 35 mm equivalent by more than 10 %, or no camera's",
        );
    }
    if let (Some(focal_35mm), Some(equivalent)) = (metadata.focal_35mm, equivalent) {
        let EquivalentFocal {
            focal_px,
            relative_sigma,
            reading,
        } = equivalent;
        if FOV_RANGE_DEG.contains(&fov_deg(f64::from(original_px.0), focal_px)) {
            view.use_evidence("FocalLengthIn35mmFilm", format!("{focal_35mm} mm"), reading);
            return Some(Uncertain {
                value: focal_px,
                relative_sigma,
            });
        }
        view.set_aside(
            "FocalLengthIn35mmFilm",
            format!("{focal_35mm} mm"),
            "no camera's",
        );
    }
    let focal_plane = metadata.focal_plane_px?;
    view.use_evidence(
        "FocalPlaneXResolution",
        format!("{focal_plane:.0} px"),
        "focal length by the density of pixels on the sensor",
    );
    Some(Uncertain {
        value: focal_plane,
        relative_sigma: FOCAL_PLANE_SIGMA,
    })
}

fn metres(value: f64) -> String {
    format!("{value} m")
}
