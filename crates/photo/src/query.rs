//! A photo as the map would show it: a given ground resolution, the map's up direction up.

use image::{GrayImage, RgbImage};
use nalgebra::{Matrix3, Vector3};

use crate::area::{self, Crop};
use crate::camera::{MAX_DEPTH_RATIO, MAX_PITCH_FROM_NADIR_DEG, Tilt, focal_px};
use crate::error::PhotoError;
use crate::padded_image::PaddedImage;
use crate::points::{PhotoPx, QueryPx};
use crate::warp::{self, Interpolation, LEVEL_PX_PER_QUERY_PX};

/// Query sides are multiples of this, as the network needs.
pub const SIDE_MULTIPLE_PX: u32 = 32;

/// The default limit of a query's sides, px.
pub const DEFAULT_MAX_SIDE_PX: u32 = 1024;

/// Resolution and size of a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QueryOptions {
    /// Ground metres per query pixel.
    pub gsd_m: f64,
    /// Ground width across the photo's centre, m.
    pub footprint_width_m: f64,
    /// Tilt of the camera to rectify.
    pub tilt: Option<Tilt>,
    /// Larger queries are cropped around the photo's centre; rounded down to a multiple of 32.
    pub max_side_px: u32,
}

impl QueryOptions {
    /// A camera that looks straight down, with the default size limit.
    pub fn new(gsd_m: f64, footprint_width_m: f64) -> Self {
        Self {
            gsd_m,
            footprint_width_m,
            tilt: None,
            max_side_px: DEFAULT_MAX_SIDE_PX,
        }
    }
}

/// A resampled photo.
#[derive(Debug, Clone)]
pub struct Query {
    /// Pixels; black outside the photo. Both sides are multiples of 32.
    pub image: RgbImage,
    /// 255 inside the photo, 0 outside.
    pub mask: GrayImage,
    /// Pixels of `Photo::image` from query pixels, both continuous: (0, 0) is the outer corner of the top left pixel,
    /// the centre of pixel (i, j) is (i + 0.5, j + 0.5). The photo's centre lies at the query's centre.
    pub photo_px_from_query_px: Matrix3<f64>,
    /// Ground metres per query pixel.
    pub gsd_m: f64,
    /// Bearing of the photo's top relative to the query's up, degrees clockwise.
    pub up_deg: f64,
}

impl Default for Query {
    fn default() -> Self {
        Self {
            image: RgbImage::new(0, 0),
            mask: GrayImage::new(0, 0),
            photo_px_from_query_px: Matrix3::identity(),
            gsd_m: 0.0,
            up_deg: 0.0,
        }
    }
}

impl Query {
    /// The position of the photo's centre: the query's own centre.
    pub fn centre_px(&self) -> QueryPx {
        QueryPx::new(
            f64::from(self.image.width()) / 2.0,
            f64::from(self.image.height()) / 2.0,
        )
    }

    /// The point of the photo that a point of the query shows; `None` beyond the horizon of a rectified query.
    pub fn photo_px(&self, point: QueryPx) -> Option<PhotoPx> {
        let [x, y] = apply(&self.photo_px_from_query_px, [point.x, point.y])?;
        Some(PhotoPx::new(x, y))
    }
}

/// `matrix` applied to a point; `None` if the homogeneous coordinate is not positive.
fn apply(matrix: &Matrix3<f64>, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let mapped = matrix * Vector3::new(x, y, 1.0);
    (mapped.z > 1e-12).then(|| [mapped.x / mapped.z, mapped.y / mapped.z])
}

/// A photo prepared for queries at one ground resolution: reduced once, then rotated as often as needed.
#[derive(Debug)]
pub struct QueryMaker {
    level: PaddedImage,
    /// Level pixels from photo pixels, continuous.
    level_from_photo: Matrix3<f64>,
    /// Photo pixels (continuous) from query pixels of an unturned query, relative to its centre.
    photo_from_unturned: Matrix3<f64>,
    /// Corners of the usable part of the photo, in unturned query pixels relative to the centre.
    outline_px: Vec<[f64; 2]>,
    interpolation: Interpolation,
    options: QueryOptions,
}

impl QueryMaker {
    /// Reduces `image` to about the query's ground resolution.
    ///
    /// # Errors
    /// Returns [`PhotoError::BadRequest`] if the resolution or the width is not a positive number, the maximum side is below 32, the
    /// field of view is invalid, or the image has no pixel; [`PhotoError::Horizon`] for tilts of more than 75 degrees.
    pub fn new(image: &RgbImage, options: &QueryOptions) -> Result<Self, PhotoError> {
        check(options)?;
        let (width, height) = image.dimensions();
        if width.min(height) == 0 {
            return Err(PhotoError::BadRequest {
                name: "the photo's shorter side",
                value: 0.0,
                reason: "expected at least 1 pixel",
            });
        }
        let size = [f64::from(width), f64::from(height)];
        let centred_from_photo = translation(-size[0] / 2.0, -size[1] / 2.0);
        let photo_gsd_m = options.footprint_width_m / size[0];
        let ground_from_centred = match options.tilt {
            None => scaling(photo_gsd_m, photo_gsd_m),
            Some(tilt) => {
                let focal = focal_px(size[0], tilt.hfov_deg);
                tilt.ground_from_centred_px(focal, photo_gsd_m * focal)
            }
        };
        let unturned_from_photo = scaling(1.0 / options.gsd_m, 1.0 / options.gsd_m)
            * ground_from_centred
            * centred_from_photo;
        let bad_tilt = || PhotoError::BadRequest {
            name: "tilt",
            value: options.tilt.map_or(0.0, |tilt| tilt.pitch_from_nadir_deg),
            reason: "the camera does not see the ground plane",
        };
        let photo_from_unturned = unturned_from_photo.try_inverse().ok_or_else(bad_tilt)?;
        let outline_px = usable_outline(size, &unturned_from_photo);
        if outline_px.len() < 3 {
            return Err(bad_tilt());
        }
        let photo_px_per_query_px = options.gsd_m / photo_gsd_m;
        let crop = visible_crop((width, height), photo_px_per_query_px, options);
        let reduction = (photo_px_per_query_px / LEVEL_PX_PER_QUERY_PX).max(1.0);
        let level_side = |px: u32| ((f64::from(px) / reduction).round() as u32).max(1);
        let (level_width, level_height) = (level_side(crop.width), level_side(crop.height));
        let level = if (level_width, level_height) == (crop.width, crop.height) {
            PaddedImage::new(image, crop)
        } else {
            let reduced = area::reduce(image, crop, level_width, level_height);
            PaddedImage::new(&reduced, Crop::whole(reduced.dimensions()))
        };
        let level_from_photo = scaling(
            f64::from(level_width) / f64::from(crop.width),
            f64::from(level_height) / f64::from(crop.height),
        ) * translation(-f64::from(crop.x), -f64::from(crop.y));
        Ok(Self {
            level,
            level_from_photo,
            photo_from_unturned,
            outline_px,
            interpolation: Interpolation::suited_to(photo_px_per_query_px / reduction),
            options: *options,
        })
    }

    /// The query with the photo's top at bearing `up_deg` from the query's up, degrees clockwise.
    pub fn make(&self, up_deg: f64) -> Query {
        let mut query = Query::default();
        self.make_into(up_deg, &mut query);
        query
    }

    /// As [`QueryMaker::make`], reusing the buffers of an earlier query.
    pub fn make_into(&self, up_deg: f64, query: &mut Query) {
        let (sin, cos) = up_deg.to_radians().sin_cos();
        // Clockwise by up_deg, in pixels with y down.
        let turned = |[x, y]: [f64; 2]| [x * cos - y * sin, x * sin + y * cos];
        let mut half = [0.0f64; 2];
        for corner in &self.outline_px {
            let corner = turned(*corner);
            half = [half[0].max(corner[0].abs()), half[1].max(corner[1].abs())];
        }
        let limit = (self.options.max_side_px / SIDE_MULTIPLE_PX).max(1);
        let side = |half: f64| {
            // Rounding errors of the product must not add 32 px.
            let multiples = (2.0 * half / f64::from(SIDE_MULTIPLE_PX) - 1e-9).ceil();
            (multiples.max(1.0) as u32).min(limit) * SIDE_MULTIPLE_PX
        };
        let (width, height) = (side(half[0]), side(half[1]));
        let unturned_from_query = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0)
            * translation(-f64::from(width) / 2.0, -f64::from(height) / 2.0);
        let photo_from_query = self.photo_from_unturned * unturned_from_query;
        let photo_from_query = photo_from_query / centre_depth(&photo_from_query, width, height);
        query.photo_px_from_query_px = photo_from_query;
        query.gsd_m = self.options.gsd_m;
        query.up_deg = up_deg;
        let buffer = |old: Vec<u8>, channels: usize| {
            let mut buffer = old;
            buffer.clear();
            buffer.resize(width as usize * height as usize * channels, 0);
            buffer
        };
        let rgb = buffer(std::mem::take(&mut query.image).into_raw(), 3);
        let seen = buffer(std::mem::take(&mut query.mask).into_raw(), 1);
        query.image = RgbImage::from_raw(width, height, rgb).unwrap_or_default();
        query.mask = GrayImage::from_raw(width, height, seen).unwrap_or_default();
        warp::warp(
            &self.level,
            &(self.level_from_photo * photo_from_query),
            self.interpolation,
            MAX_DEPTH_RATIO,
            &mut query.image,
            &mut query.mask,
        );
    }
}

/// The homogeneous coordinate at a query's centre, so that it can be made 1 there.
fn centre_depth(matrix: &Matrix3<f64>, width: u32, height: u32) -> f64 {
    (matrix * Vector3::new(f64::from(width) / 2.0, f64::from(height) / 2.0, 1.0)).z
}

fn check(options: &QueryOptions) -> Result<(), PhotoError> {
    let positive = [
        ("gsd_m", options.gsd_m),
        ("footprint_width_m", options.footprint_width_m),
    ];
    for (name, value) in positive {
        if !(value.is_finite() && value > 0.0) {
            return Err(PhotoError::BadRequest {
                name,
                value,
                reason: "expected a positive number of metres",
            });
        }
    }
    if options.max_side_px < SIDE_MULTIPLE_PX {
        return Err(PhotoError::BadRequest {
            name: "max_side_px",
            value: f64::from(options.max_side_px),
            reason: "expected at least 32 pixels",
        });
    }
    let Some(tilt) = options.tilt else {
        return Ok(());
    };
    if !(tilt.hfov_deg > 0.0 && tilt.hfov_deg < 179.0) {
        return Err(PhotoError::BadRequest {
            name: "hfov_deg",
            value: tilt.hfov_deg,
            reason: "expected a field of view between 0 and 179 degrees",
        });
    }
    if !tilt.roll_deg.is_finite() {
        return Err(PhotoError::BadRequest {
            name: "roll_deg",
            value: tilt.roll_deg,
            reason: "expected a finite number of degrees",
        });
    }
    let pitch_from_nadir_deg = tilt.pitch_from_nadir_deg;
    if pitch_from_nadir_deg.is_nan() || pitch_from_nadir_deg.abs() > MAX_PITCH_FROM_NADIR_DEG {
        return Err(PhotoError::Horizon {
            pitch_from_nadir_deg,
            limit_deg: MAX_PITCH_FROM_NADIR_DEG,
        });
    }
    Ok(())
}

/// The outline of the part of the photo that is near enough, mapped to unrotated query pixels.
///
/// The homogeneous coordinate is 1 at the centre and falls to 0 at the horizon; it is linear in photo pixels, so the
/// far part is cut off along a straight line (Sutherland and Hodgman 1974).
fn usable_outline(size: [f64; 2], unturned_from_photo: &Matrix3<f64>) -> Vec<[f64; 2]> {
    let nearness = |[x, y]: [f64; 2]| {
        (unturned_from_photo * Vector3::new(x, y, 1.0)).z - 1.0 / MAX_DEPTH_RATIO
    };
    let corners = [
        [0.0, 0.0],
        [size[0], 0.0],
        [size[0], size[1]],
        [0.0, size[1]],
    ];
    let mut outline = Vec::with_capacity(6);
    for (index, &from) in corners.iter().enumerate() {
        let to = corners[(index + 1) % corners.len()];
        let (near_from, near_to) = (nearness(from), nearness(to));
        if near_from >= 0.0 {
            outline.push(from);
        }
        if (near_from >= 0.0) != (near_to >= 0.0) {
            let share = near_from / (near_from - near_to);
            outline.push([
                from[0] + share * (to[0] - from[0]),
                from[1] + share * (to[1] - from[1]),
            ]);
        }
    }
    outline
        .into_iter()
        .filter_map(|corner| apply(unturned_from_photo, corner))
        .collect()
}

/// The central part of the photo that queries of the maximum side can show at any rotation, with a margin for the
/// filters; the whole photo if it is tilted.
fn visible_crop(
    (width, height): (u32, u32),
    photo_px_per_query_px: f64,
    options: &QueryOptions,
) -> Crop {
    if options.tilt.is_some() {
        return Crop::whole((width, height));
    }
    let half_diagonal = f64::from(options.max_side_px) * std::f64::consts::FRAC_1_SQRT_2;
    let reach = ((half_diagonal + 4.0) * photo_px_per_query_px).ceil();
    let cut = |side: u32| {
        let margin = (f64::from(side) / 2.0 - reach).floor().max(0.0) as u32;
        (margin, side - 2 * margin)
    };
    let ((x, width), (y, height)) = (cut(width), cut(height));
    Crop {
        x,
        y,
        width,
        height,
    }
}

fn translation(x: f64, y: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, 0.0, x, 0.0, 1.0, y, 0.0, 0.0, 1.0)
}

fn scaling(x: f64, y: f64) -> Matrix3<f64> {
    Matrix3::new(x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 1.0)
}
