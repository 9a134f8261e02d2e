//! One photo of AnyVisLoc: its picture, camera and pose.

use std::io;
use std::path::Path;

use grimnet_world::{PhotoTags, write_jpeg_with_exif};
use image::RgbImage;

use super::lonlat;
use crate::npz::Npz;
use crate::truth::TruthFrame;

/// Quality of the JPEG that a picture is written as.
const JPEG_QUALITY: u8 = 95;

/// A line of sight further off straight down than this does not meet the ground in any useful place, degrees.
const MAX_PITCH_DEG: f64 = 80.0;

/// Width of the film that focal lengths in the metadata are of, millimetres.
const FILM_WIDTH_MM: f64 = 36.0;

/// What a sample holds.
pub(super) struct Sample {
    npz: Npz,
    /// Focal length along x, pixels of the picture.
    focal_px: f64,
    /// Place of the camera in the scene's plane: east, south, above the mean ground; metres.
    xyz_m: [f64; 3],
    /// Roll, pitch off straight down (positive: ahead), yaw clockwise from north; degrees.
    euler_deg: [f64; 3],
}

impl Sample {
    pub fn open(path: &Path) -> io::Result<Self> {
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

    fn check(&self) -> io::Result<()> {
        let [_, pitch_deg, _] = self.euler_deg;
        if self.focal_px <= 0.0 {
            return Err(io::Error::other("`K` has no positive focal length"));
        }
        if self.xyz_m[2] <= 0.0 {
            return Err(io::Error::other("the camera is below the mean ground"));
        }
        if pitch_deg.abs() > MAX_PITCH_DEG {
            return Err(io::Error::other(format!(
                "the camera looks {pitch_deg:.0} degrees off straight down, past the map"
            )));
        }
        Ok(())
    }

    /// Where the line of sight meets the mean ground: metres to the east and to the south.
    fn centre_m(&self) -> [f64; 2] {
        let ([x, y, z], [_, pitch_deg, yaw_deg]) = (self.xyz_m, self.euler_deg);
        let ahead_m = z * pitch_deg.to_radians().tan();
        let (sin, cos) = yaw_deg.to_radians().sin_cos();
        [x + ahead_m * sin, y - ahead_m * cos]
    }

    /// The truth of this sample, whose picture is written into `photos` if it is not there.
    pub fn frame(mut self, npz: &Path, photos: &Path) -> io::Result<TruthFrame> {
        let photo = format!(
            "{}.jpg",
            npz.file_stem().unwrap_or_default().to_string_lossy()
        );
        let path = photos.join(&photo);
        if !path.is_file() {
            let image = picture(&mut self.npz)?;
            write_jpeg_with_exif(&path, &image, JPEG_QUALITY, &self.tags(image.width()))
                .map_err(io::Error::other)?;
        }
        let [x, y] = self.centre_m();
        let (centre, camera) = (lonlat(x, y), lonlat(self.xyz_m[0], self.xyz_m[1]));
        Ok(TruthFrame {
            photo,
            centre_lat_lon_deg: Some((centre.lat_deg, centre.lon_deg)),
            gps_lat_lon_deg: Some((camera.lat_deg, camera.lon_deg)),
            heading_deg: Some(self.euler_deg[2]),
            height_agl_m: Some(self.xyz_m[2]),
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

/// The first numbers of an array, all finite.
fn vector<const N: usize>(npz: &mut Npz, name: &str) -> io::Result<[f64; N]> {
    let array = npz.floats(name)?;
    array
        .values
        .try_into()
        .ok()
        .filter(|values: &[f64; N]| values.iter().all(|v| v.is_finite()))
        .ok_or_else(|| io::Error::other(format!("`{name}` is not {N} finite numbers")))
}

fn picture(npz: &mut Npz) -> io::Result<RgbImage> {
    let array = npz.bytes("image")?;
    let [height, width, 3] = array.shape[..] else {
        return Err(io::Error::other(format!(
            "`image` has the shape {:?} and not height, width, 3",
            array.shape
        )));
    };
    RgbImage::from_raw(width as u32, height as u32, array.values)
        .filter(|image| image.width() > 0 && image.height() > 0)
        .ok_or_else(|| io::Error::other("`image` is empty"))
}
