//! Photos cut from nadir pictures under a homography and a change of light, without parallax.

use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage, imageops};
use nalgebra::{Matrix3, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::normal::normal;
use grimnet_photo::pictures::picture_files;

/// Least side of a picture from which photos are cut, pixels.
const MIN_SIDE_PX: u32 = 640;
/// Pictures in a row of the mosaic.
const COLUMNS: u32 = 4;
/// Largest number of pictures used of a folder.
const MAX_PICTURES: usize = 16;

/// Why a folder of pictures cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MosaicError {
    /// A folder cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A picture cannot be decoded.
    #[error("{path}: {source}")]
    Picture {
        /// The file.
        path: PathBuf,
        /// The decoder's error.
        source: image::ImageError,
    },
    /// The folder has no usable pictures.
    #[error("{path}: no JPEG or PNG picture of at least {min_px} x {min_px} pixels")]
    NoPictures {
        /// The folder.
        path: PathBuf,
        /// Least side, pixels.
        min_px: u32,
    },
}

/// Pictures side by side, each cropped to the smallest.
#[derive(Debug)]
pub struct Mosaic {
    /// All of them.
    pub picture: RgbImage,
    /// Size of one, pixels.
    pub cell_px: (u32, u32),
    /// How many there are.
    pub cells: u32,
}

impl Mosaic {
    /// Reads the pictures of a folder in the order of their names.
    ///
    /// # Errors
    /// No picture that is large enough, or one that cannot be decoded.
    pub fn of_folder(folder: &Path) -> Result<Self, MosaicError> {
        // TIFF and WebP pictures are left out, as when the bundled model was calibrated.
        let paths = picture_files(folder)?.into_iter().filter(|path| {
            let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
            ["jpg", "jpeg", "png"].contains(&extension.to_ascii_lowercase().as_str())
        });
        let mut pictures = Vec::new();
        for path in paths {
            let picture = image::open(&path)
                .map_err(|source| MosaicError::Picture { path, source })?
                .to_rgb8();
            if picture.width().min(picture.height()) >= MIN_SIDE_PX {
                pictures.push(picture);
            }
            if pictures.len() == MAX_PICTURES {
                break;
            }
        }
        let smallest = |side: fn(&RgbImage) -> u32| pictures.iter().map(side).min();
        let (Some(w), Some(h)) = (smallest(RgbImage::width), smallest(RgbImage::height)) else {
            return Err(MosaicError::NoPictures {
                path: folder.to_owned(),
                min_px: MIN_SIDE_PX,
            });
        };
        let cells = pictures.len() as u32;
        let columns = COLUMNS.min(cells);
        let mut picture = RgbImage::new(columns * w, cells.div_ceil(columns) * h);
        for (i, part) in pictures.iter().enumerate() {
            let (column, row) = (i as u32 % columns, i as u32 / columns);
            let part = imageops::crop_imm(part, 0, 0, w, h).to_image();
            imageops::replace(
                &mut picture,
                &part,
                i64::from(column * w),
                i64::from(row * h),
            );
        }
        Ok(Self {
            picture,
            cell_px: (w, h),
            cells,
        })
    }

    fn origin_px(&self, cell: u32) -> [f64; 2] {
        let columns = COLUMNS.min(self.cells);
        let (w, h) = self.cell_px;
        [f64::from(cell % columns * w), f64::from(cell / columns * h)]
    }
}

/// The transform by which a photo is cut.
#[derive(Debug, Clone, Copy)]
pub struct Cut {
    /// Continuous mosaic pixels from continuous photo pixels.
    map_px_from_photo_px: Matrix3<f64>,
    /// The photo's centre, mosaic pixels.
    pub centre_map_px: [f64; 2],
    /// Direction of the photo's top, degrees clockwise from the mosaic's up.
    pub heading_deg: f64,
    /// Size of a photo pixel at the centre.
    pub map_px_per_photo_px: f64,
}

impl Cut {
    /// A random photo within one picture, with any heading and some degrees of tilt.
    pub fn random(mosaic: &Mosaic, photo_px: (u32, u32), rng: &mut ChaCha8Rng) -> Self {
        let (w, h) = (f64::from(photo_px.0), f64::from(photo_px.1));
        let half_diagonal = w.hypot(h) / 2.0;
        let short = f64::from(mosaic.cell_px.0.min(mosaic.cell_px.1));
        let largest = short / (2.0 * half_diagonal) * 0.95;
        let scale = largest * rng.random_range(0.7..1.0);
        let reach = half_diagonal * scale * 1.05;
        let cell = rng.random_range(0..mosaic.cells);
        let [left, top] = mosaic.origin_px(cell);
        let mut within = |side: u32| {
            let side = f64::from(side);
            let reach = reach.min(side / 2.0);
            rng.random_range(reach..=(side - reach).max(reach))
        };
        let centre = [
            left + within(mosaic.cell_px.0),
            top + within(mosaic.cell_px.1),
        ];
        let heading_deg = rng.random_range(0.0..360.0);
        let (sin, cos) = f64::to_radians(heading_deg).sin_cos();
        let turn = Matrix3::new(
            cos * scale,
            -sin * scale,
            centre[0],
            sin * scale,
            cos * scale,
            centre[1],
            0.0,
            0.0,
            1.0,
        );
        // A perspective row of tan(tilt) / focal length; 2 degrees 1-sigma behind a lens of one photo width.
        let mut tilt = || (2.0 * normal(rng)).to_radians().tan() / w;
        let perspective = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, tilt(), tilt(), 1.0);
        let to_centre = Matrix3::new(1.0, 0.0, -w / 2.0, 0.0, 1.0, -h / 2.0, 0.0, 0.0, 1.0);
        Self {
            map_px_from_photo_px: turn * perspective * to_centre,
            centre_map_px: centre,
            heading_deg,
            map_px_per_photo_px: scale,
        }
    }

    /// The photo, under a random change of light.
    pub fn photo(&self, mosaic: &Mosaic, photo_px: (u32, u32), rng: &mut ChaCha8Rng) -> RgbImage {
        let gain: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.8..1.2));
        let exposure = rng.random_range(0.7..1.3);
        let gamma: f64 = rng.random_range(0.75..1.35);
        let noise = rng.random_range(1.0..6.0);
        let blur = rng.random_range(0.3..1.2);
        let mut photo = RgbImage::new(photo_px.0, photo_px.1);
        for (x, y, pixel) in photo.enumerate_pixels_mut() {
            let at = self.map_px_from_photo_px
                * Vector3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0);
            let colour = bilinear(&mosaic.picture, at.x / at.z - 0.5, at.y / at.z - 0.5);
            *pixel = Rgb(std::array::from_fn(|c| {
                let tone = (colour[c] / 255.0).powf(gamma) * exposure * gain[c];
                (tone * 255.0).clamp(0.0, 255.0) as u8
            }));
        }
        let mut photo = imageops::blur(&photo, blur);
        for value in photo.iter_mut() {
            *value = (f64::from(*value) + noise * normal(rng)).clamp(0.0, 255.0) as u8;
        }
        photo
    }
}

/// Colour at integer-centred pixel coordinates; the border is replicated.
fn bilinear(picture: &RgbImage, x: f64, y: f64) -> [f64; 3] {
    let (w, h) = picture.dimensions();
    let clamp = |v: f64, n: u32| v.clamp(0.0, f64::from(n - 1));
    let (x, y) = (clamp(x, w), clamp(y, h));
    let (left, top) = (x.floor() as u32, y.floor() as u32);
    let (right, bottom) = ((left + 1).min(w - 1), (top + 1).min(h - 1));
    let (u, v) = (x.fract(), y.fract());
    let at = |x, y, c: usize| f64::from(picture.get_pixel(x, y)[c]);
    std::array::from_fn(|c| {
        let upper = at(left, top, c) * (1.0 - u) + at(right, top, c) * u;
        let lower = at(left, bottom, c) * (1.0 - u) + at(right, bottom, c) * u;
        upper * (1.0 - v) + lower * v
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn the_middle_of_a_cut_shows_its_centre_and_its_top_its_heading() {
        let mosaic = Mosaic {
            picture: RgbImage::from_fn(800, 700, |x, y| Rgb([(x / 4) as u8, (y / 4) as u8, 0])),
            cell_px: (800, 700),
            cells: 1,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        for _ in 0..20 {
            let cut = Cut::random(&mosaic, (64, 48), &mut rng);
            let map = |x: f64, y: f64| {
                let at = cut.map_px_from_photo_px * Vector3::new(x, y, 1.0);
                [at.x / at.z, at.y / at.z]
            };
            let centre = map(32.0, 24.0);
            assert!((centre[0] - cut.centre_map_px[0]).abs() < 1e-9);
            assert!((centre[1] - cut.centre_map_px[1]).abs() < 1e-9);
            let up = map(32.0, 23.9);
            let bearing = (up[0] - centre[0]).atan2(centre[1] - up[1]).to_degrees();
            let off = grimnet_geo::turn_deg(cut.heading_deg, bearing);
            assert!(off.abs() < 2.0, "{bearing} against {}", cut.heading_deg);
        }
    }

    #[test]
    fn a_folder_of_other_pictures_is_told_which_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let large = RgbImage::new(MIN_SIDE_PX, MIN_SIDE_PX);
        large.save(folder.path().join("a.tif")).unwrap();
        let error = Mosaic::of_folder(folder.path()).unwrap_err().to_string();
        assert!(error.contains("no JPEG or PNG picture"), "{error}");
    }
}
