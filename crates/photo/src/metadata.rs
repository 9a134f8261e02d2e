//! Metadata of a photo as read from EXIF and XMP.

use serde::Serialize;

use crate::evidence::Evidence;
use crate::exposure_time::ExposureTime;

/// Two pictures whose aspect ratios differ by less than this share have the same shape: sizes are rounded.
pub(crate) const SAME_ASPECT: f64 = 0.01;

/// Position recorded by a GNSS receiver. It is never used to localise a photo, only to check an answer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GpsPosition {
    /// Latitude, degrees, north positive.
    pub lat_deg: f64,
    /// Longitude, degrees, east positive.
    pub lon_deg: f64,
}

/// Bearing of EXIF's `GPSImgDirection`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ImageDirection {
    /// Degrees clockwise from the reference.
    pub bearing_deg: f64,
    /// Whether it is relative to magnetic north (`GPSImgDirectionRef` = M) and not from true north.
    pub magnetic: bool,
}

/// Metadata of one photo, each field as its source gave it, in this crate's units.
///
/// A number that is not finite, not parsable or out of range is left out, with an entry in `notes`. [`crate::View::resolve`]
/// decides which of the others are used.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Metadata {
    /// GPS position (EXIF, else DJI XMP).
    pub position: Option<GpsPosition>,
    /// Yaw of the gimbal, degrees clockwise from north (DJI `GimbalYawDegree`, Parrot `CameraYawDegree`, `Camera:Yaw`).
    pub gimbal_yaw_deg: Option<f64>,
    /// Pitch of the gimbal, degrees; -90 looks straight down, 0 at the horizon.
    pub gimbal_pitch_deg: Option<f64>,
    /// Roll of the gimbal about the optical axis, degrees.
    pub gimbal_roll_deg: Option<f64>,
    /// Roll of a camera whose angles count from straight down (`Camera:Roll`), in place of the gimbal's: about the direction of
    /// the picture's top, degrees, positive with the right side down, so that a camera that looks down then looks to the left.
    pub nadir_roll_deg: Option<f64>,
    /// Yaw of the aircraft, degrees clockwise from north.
    pub flight_yaw_deg: Option<f64>,
    /// Pitch of the aircraft, degrees.
    pub flight_pitch_deg: Option<f64>,
    /// Roll of the aircraft, degrees.
    pub flight_roll_deg: Option<f64>,
    /// EXIF's image direction.
    pub image_direction: Option<ImageDirection>,
    /// Height above the take-off point, m.
    pub relative_altitude_m: Option<f64>,
    /// Altitude above sea level or the ellipsoid, m; not a height above ground.
    pub gps_altitude_m: Option<f64>,
    /// Height above ground by an on-board rangefinder or terrain model, m.
    pub above_ground_m: Option<f64>,
    /// Focal length, mm.
    pub focal_length_mm: Option<f64>,
    /// 35 mm equivalent focal length, mm.
    pub focal_35mm: Option<f64>,
    /// Calibrated focal length in pixels of the full-size picture (DJI `CalibratedFocalLength`).
    pub calibrated_focal_px: Option<f64>,
    /// Focal length in pixels from EXIF's focal plane resolution.
    pub focal_plane_px: Option<f64>,
    /// Digital zoom, 1 for none.
    pub digital_zoom: Option<f64>,
    /// Size that the camera stored, px, before orientation (EXIF `PixelXDimension`, `PixelYDimension`).
    pub original_size_px: Option<(u32, u32)>,
    /// EXIF orientation, 1 to 8; 1 where absent. 0, which [`Metadata::default`] has, counts as 1.
    pub orientation: u8,
    /// Camera maker.
    pub make: Option<String>,
    /// Camera model.
    pub model: Option<String>,
    /// When it was taken, with fractions of a second and the time zone where the camera recorded them.
    pub exposure_time: Option<ExposureTime>,
    /// Fields that could not be read, and why.
    pub notes: Vec<Evidence>,
}

impl Metadata {
    /// Whether EXIF orientation turns the stored picture by a quarter, so that width and height change places.
    pub fn swaps_sides(&self) -> bool {
        (5..=8).contains(&self.orientation)
    }

    /// Whether the stored picture is turned or mirrored for display.
    pub(crate) fn is_stored_turned(&self) -> bool {
        (2..=8).contains(&self.orientation)
    }

    /// The size of the file's picture, of which that of the displayed one is given, pixels.
    pub(crate) fn stored_px(&self, (width, height): (u32, u32)) -> (u32, u32) {
        if self.swaps_sides() {
            (height, width)
        } else {
            (width, height)
        }
    }

    /// Whether the picture was turned by a quarter after it was taken: its stored size is that which the camera stored, with width
    /// and height exchanged. Programs that turn pixels often leave the other metadata.
    pub(crate) fn was_turned(&self, stored_px: (u32, u32)) -> bool {
        let aspect = |(width, height): (u32, u32)| f64::from(width) / f64::from(height);
        let is_like = |other: f64| (aspect(stored_px) / other - 1.0).abs() < SAME_ASPECT;
        self.original_size_px.is_some_and(|original_px| {
            is_like(1.0 / aspect(original_px)) && !is_like(aspect(original_px))
        })
    }

    pub(crate) fn note(&mut self, field: &str, value: impl Into<String>, reason: &str) {
        let note = Evidence::new(field, value, reason);
        tracing::debug!(%note, "metadata field not readable");
        self.notes.push(note);
    }

    /// Sets the position if it is valid and none was set. Receivers without a fix write (0, 0).
    pub(crate) fn take_position(&mut self, source: &str, lat_deg: f64, lon_deg: f64) {
        if self.position.is_some() {
            return;
        }
        let value = format!("{lat_deg}, {lon_deg}");
        if !(lat_deg.is_finite() && lon_deg.is_finite()) {
            self.note(source, value, "not a number");
        } else if lat_deg.abs() > 90.0 || lon_deg.abs() > 180.0 {
            self.note(source, value, "latitude or longitude out of range");
        } else if lat_deg == 0.0 && lon_deg == 0.0 {
            self.note(source, value, "receivers without a fix write 0, 0");
        } else {
            self.position = Some(GpsPosition { lat_deg, lon_deg });
        }
    }
}
