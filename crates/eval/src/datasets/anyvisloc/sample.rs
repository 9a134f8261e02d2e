//! One photo of AnyVisLoc: its picture, camera and pose.

use std::path::Path;

use grimnet_photo::HEADING_RANGE_DEG;
use grimnet_world::{PhotoTags, WorldError, write_jpeg_with_exif};
use image::RgbImage;

use super::plane::lonlat;
use crate::datasets::npz::{Npz, NpzError};
use crate::datasets::truth::TruthFrame;

/// JPEG quality of the written pictures.
const JPEG_QUALITY: u8 = 95;

/// Largest angle between the line of sight and straight down at which the image centre is useful, degrees.
const MAX_PITCH_DEG: f64 = 80.0;

/// Film width that focal lengths in the metadata refer to, millimetres.
const FILM_WIDTH_MM: f64 = 36.0;

/// Why a sample cannot be used.
#[derive(Debug, thiserror::Error)]
pub(super) enum SampleError {
    /// An array cannot be read.
    #[error(transparent)]
    Npz(#[from] NpzError),
    /// An array has another shape or content.
    #[error("array `{name}`: {found}; expected {expected}")]
    Content {
        /// Name of the array.
        name: &'static str,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The camera looks past the map.
    #[error(
        "the camera is tilted {pitch_deg:.0} degrees from nadir; expected at most {MAX_PITCH_DEG:.0}"
    )]
    Pitch {
        /// Angle off straight down, degrees.
        pitch_deg: f64,
    },
    /// The picture cannot be written.
    #[error(transparent)]
    Write(#[from] WorldError),
}

fn content(
    name: &'static str,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> SampleError {
    SampleError::Content {
        name,
        found: found.into(),
        expected: expected.into(),
    }
}

/// The content of a sample file.
pub(super) struct Sample {
    npz: Npz,
    /// Focal length along x, pixels of the picture.
    focal_px: f64,
    /// Position of the camera in the scene's plane: east, south, above the mean ground; metres.
    xyz_m: [f64; 3],
    /// Roll, pitch off straight down (positive: ahead), yaw clockwise from north; degrees.
    euler_deg: [f64; 3],
}

impl Sample {
    pub fn open(path: &Path) -> Result<Self, SampleError> {
        let mut npz = Npz::open(path)?;
        let matrix = vector::<9>(&mut npz, "K")?;
        let sample = Self {
            focal_px: matrix[0],
            xyz_m: vector(&mut npz, "xyz")?,
            euler_deg: vector(&mut npz, "euler_deg")?,
            npz,
        };
        sample.check()?;
        Ok(sample)
    }

    fn check(&self) -> Result<(), SampleError> {
        let [_, pitch_deg, yaw_deg] = self.euler_deg;
        if self.focal_px <= 0.0 {
            let found = format!("focal length {}", self.focal_px);
            return Err(content("K", found, "a positive focal length in pixels"));
        }
        if self.xyz_m[2] <= 0.0 {
            let found = format!("height {} m", self.xyz_m[2]);
            return Err(content("xyz", found, "a height above the mean ground"));
        }
        if pitch_deg.abs() > MAX_PITCH_DEG {
            return Err(SampleError::Pitch { pitch_deg });
        }
        if !HEADING_RANGE_DEG.contains(&yaw_deg) {
            let found = format!("yaw {yaw_deg}");
            return Err(content("euler_deg", found, "degrees from -720 to 720"));
        }
        Ok(())
    }

    /// Intersection of the line of sight with the mean ground: metres to the east and to the south.
    fn centre_m(&self) -> [f64; 2] {
        let ([x, y, z], [_, pitch_deg, yaw_deg]) = (self.xyz_m, self.euler_deg);
        let ahead_m = z * pitch_deg.to_radians().tan();
        let (sin, cos) = yaw_deg.to_radians().sin_cos();
        [x + ahead_m * sin, y - ahead_m * cos]
    }

    /// Truth of this sample; its picture is written into `photos` unless it exists.
    pub fn frame(mut self, npz: &Path, photos: &Path) -> Result<TruthFrame, SampleError> {
        let photo = format!(
            "{}.jpg",
            npz.file_stem().unwrap_or_default().to_string_lossy()
        );
        let path = photos.join(&photo);
        if !path.is_file() {
            let image = picture(&mut self.npz)?;
            write_jpeg_with_exif(&path, &image, JPEG_QUALITY, &self.tags(image.width()))?;
        }
        let [x, y] = self.centre_m();
        let (centre, camera) = (lonlat(x, y), lonlat(self.xyz_m[0], self.xyz_m[1]));
        Ok(TruthFrame {
            photo,
            centre_lat_lon_deg: Some((centre.lat_deg, centre.lon_deg)),
            gps_lat_lon_deg: Some((camera.lat_deg, camera.lon_deg)),
            heading_deg: Some(self.euler_deg[2]),
            height_agl_m: Some(self.xyz_m[2]),
            tilt_deg: Some(self.euler_deg[1].abs()),
            ..TruthFrame::default()
        })
    }

    fn tags(&self, width_px: u32) -> PhotoTags {
        let camera = lonlat(self.xyz_m[0], self.xyz_m[1]);
        let [roll_deg, pitch_deg, yaw_deg] = self.euler_deg;
        let focal_mm = self.focal_px / f64::from(width_px) * FILM_WIDTH_MM;
        PhotoTags {
            lat_deg: camera.lat_deg,
            lon_deg: camera.lon_deg,
            gps_altitude_m: self.xyz_m[2],
            relative_altitude_m: self.xyz_m[2],
            gimbal_yaw_deg: yaw_deg,
            gimbal_pitch_deg: pitch_deg - 90.0,
            gimbal_roll_deg: roll_deg,
            flight_yaw_deg: yaw_deg,
            focal_length_mm: focal_mm,
            focal_35mm: focal_mm,
            calibrated_focal_px: self.focal_px,
            make: "DJI".into(),
            model: "AnyVisLoc".into(),
            taken: String::new(),
        }
    }
}

/// The numbers of an array of `N` values, all finite.
fn vector<const N: usize>(npz: &mut Npz, name: &'static str) -> Result<[f64; N], SampleError> {
    let array = npz.floats(name)?;
    array
        .values
        .try_into()
        .ok()
        .filter(|values: &[f64; N]| values.iter().all(|v| v.is_finite()))
        .ok_or_else(|| content(name, "other values", format!("{N} finite numbers")))
}

fn picture(npz: &mut Npz) -> Result<RgbImage, SampleError> {
    let array = npz.bytes("image")?;
    let [height, width, 3] = array.shape[..] else {
        let found = format!("shape {:?}", array.shape);
        return Err(content("image", found, "height, width, 3"));
    };
    RgbImage::from_raw(width as u32, height as u32, array.values)
        .filter(|image| image.width() > 0 && image.height() > 0)
        .ok_or_else(|| content("image", "no pixels", "a picture"))
}
