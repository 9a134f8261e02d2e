//! A picture of an answer: photo and map side by side, the matches between them, the outline of the photo on the map.

use grimnet_geo::{Raster, WindowPx};
use grimnet_photo::Photo;
use image::{
    Rgb, RgbImage,
    imageops::{FilterType, replace, resize},
};

use crate::{
    error::{LocateError, Result},
    outcome::{MatchedPoints, Outcome},
};

/// Size and content of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawOptions {
    /// Height of both panels, pixels.
    pub height_px: u32,
    /// Maximum width of each panel, pixels.
    pub max_panel_width_px: u32,
    /// Maximum number of outliers that are drawn. Inliers are all drawn.
    pub max_outliers: usize,
}

impl Default for DrawOptions {
    fn default() -> Self {
        Self {
            height_px: 640,
            max_panel_width_px: 1280,
            max_outliers: 200,
        }
    }
}

const INLIER: Rgb<u8> = Rgb([40, 220, 90]);
const OUTLIER: Rgb<u8> = Rgb([215, 60, 50]);
const OUTLINE: Rgb<u8> = Rgb([255, 215, 0]);
const BACKGROUND: Rgb<u8> = Rgb([40, 40, 44]);
/// Gap between the panels, pixels.
const GAP_PX: u32 = 8;
/// Margin of the map around tile and outline, as a share of their size.
const MARGIN: f64 = 0.05;

/// A rectangle of a picture shown in a panel.
struct Panel {
    /// Left edge of the panel on the canvas, pixels.
    left_px: f64,
    /// Top-left corner of what is shown, in the picture's pixels.
    origin: [f64; 2],
    /// Canvas pixels per picture pixel.
    scale: [f64; 2],
}

impl Panel {
    fn at(&self, point: [f64; 2]) -> [f64; 2] {
        [
            (point[0] - self.origin[0]) * self.scale[0] + self.left_px,
            (point[1] - self.origin[1]) * self.scale[1],
        ]
    }
}

/// Draws an answer that was made with [`crate::Options::keep_matches`]. Without a `map` its panel has a plain background.
///
/// # Errors
/// Returns [`LocateError::NoMatchesKept`] if the answer has no matched points, or an error if the map cannot be read.
pub fn draw(
    photo: &Photo,
    outcome: &Outcome,
    map: Option<&dyn Raster>,
    options: &DrawOptions,
) -> Result<RgbImage> {
    let drawn = match outcome {
        Outcome::Fix(fix) => fix.drawn.as_deref(),
        Outcome::NoFix(no_fix) => no_fix.drawn.as_deref(),
    };
    draw_matches(
        photo,
        drawn.ok_or(LocateError::NoMatchesKept)?,
        map,
        options,
    )
}

/// Draws matched points. See [`draw`].
///
/// # Errors
/// Returns an error if the map cannot be read.
pub fn draw_matches(
    photo: &Photo,
    drawn: &MatchedPoints,
    map: Option<&dyn Raster>,
    options: &DrawOptions,
) -> Result<RgbImage> {
    let height = options.height_px.max(1);
    let (photo_width, photo_height) = photo.image.dimensions();
    let left_width = panel_width(
        f64::from(photo_width) / f64::from(photo_height.max(1)),
        options,
    );
    let left = resize(&photo.image, left_width, height, FilterType::Triangle);
    let window = map_window(drawn);
    let right_width = panel_width(window.w / window.h, options);
    let right = match map {
        Some(map) => map.read(window, right_width, height)?.rgb,
        None => RgbImage::from_pixel(right_width, height, BACKGROUND),
    };
    let mut canvas =
        RgbImage::from_pixel(left_width + GAP_PX + right_width, height, Rgb([0, 0, 0]));
    replace(&mut canvas, &left, 0, 0);
    replace(&mut canvas, &right, i64::from(left_width + GAP_PX), 0);
    let on_photo = Panel {
        left_px: 0.0,
        origin: [0.0, 0.0],
        scale: [
            f64::from(left_width) / f64::from(photo_width.max(1)),
            f64::from(height) / f64::from(photo_height.max(1)),
        ],
    };
    let on_map = Panel {
        left_px: f64::from(left_width + GAP_PX),
        origin: [window.x, window.y],
        scale: [
            f64::from(right_width) / window.w,
            f64::from(height) / window.h,
        ],
    };
    let outliers = drawn
        .pairs
        .iter()
        .filter(|pair| !pair.is_inlier)
        .take(options.max_outliers);
    let inliers = drawn.pairs.iter().filter(|pair| pair.is_inlier);
    for pair in outliers.chain(inliers) {
        let from = on_photo.at([pair.photo_px.x, pair.photo_px.y]);
        let to = on_map.at([pair.map_px.x, pair.map_px.y]);
        let (colour, opacity) = if pair.is_inlier {
            (INLIER, 0.75)
        } else {
            (OUTLIER, 0.25)
        };
        line(&mut canvas, from, to, colour, opacity);
        dot(&mut canvas, from, colour);
        dot(&mut canvas, to, colour);
    }
    for (index, &corner) in drawn.outline_map_px.iter().enumerate() {
        let next = drawn.outline_map_px[(index + 1) % drawn.outline_map_px.len()];
        let (a, b) = (on_map.at([corner.x, corner.y]), on_map.at([next.x, next.y]));
        for shift in [-1.0, 0.0, 1.0] {
            // Three adjacent lines, clipped to the panel of the map.
            line_within(
                &mut canvas,
                [a[0], a[1] + shift],
                [b[0], b[1] + shift],
                OUTLINE,
                0.9,
                on_map.left_px,
            );
        }
    }
    Ok(canvas)
}

fn panel_width(aspect: f64, options: &DrawOptions) -> u32 {
    let width = f64::from(options.height_px.max(1)) * aspect;
    if width.is_finite() {
        (width.round() as u32).clamp(1, options.max_panel_width_px.max(1))
    } else {
        1
    }
}

/// The window of the map that shows tile and outline; an outline much larger than the tile is cut off.
fn map_window(drawn: &MatchedPoints) -> WindowPx {
    let WindowPx { x, y, w, h } = drawn.tile_map_px;
    let (mut low, mut high) = ([x, y], [x + w, y + h]);
    for corner in drawn
        .outline_map_px
        .iter()
        .map(|corner| [corner.x, corner.y])
    {
        for axis in 0..2 {
            let (first, side) = ([x, y][axis], [w, h][axis]);
            let along = corner[axis].clamp(first - 2.0 * side, first + 3.0 * side);
            if along.is_finite() {
                low[axis] = low[axis].min(along);
                high[axis] = high[axis].max(along);
            }
        }
    }
    let margin = [0, 1].map(|axis| (high[axis] - low[axis]) * MARGIN);
    WindowPx::new(
        low[0] - margin[0],
        low[1] - margin[1],
        high[0] - low[0] + 2.0 * margin[0],
        high[1] - low[1] + 2.0 * margin[1],
    )
}

fn line(canvas: &mut RgbImage, from: [f64; 2], to: [f64; 2], colour: Rgb<u8>, opacity: f64) {
    line_within(canvas, from, to, colour, opacity, 0.0);
}

/// An antialiased line one pixel wide, clipped to the right of `min_x`.
fn line_within(
    canvas: &mut RgbImage,
    from: [f64; 2],
    to: [f64; 2],
    colour: Rgb<u8>,
    opacity: f64,
    min_x: f64,
) {
    let (width, height) = canvas.dimensions();
    // Lines with an end far outside the canvas are not drawn.
    let far = f64::from(width.max(height)) * 4.0;
    if !from.iter().chain(&to).all(|along| along.abs() <= far) {
        return;
    }
    let along = if (to[0] - from[0]).abs() >= (to[1] - from[1]).abs() {
        0
    } else {
        1
    };
    let across = 1 - along;
    let (start, end) = if from[along] <= to[along] {
        (from, to)
    } else {
        (to, from)
    };
    let slope = if end[along] > start[along] {
        (end[across] - start[across]) / (end[along] - start[along])
    } else {
        0.0
    };
    for step in start[along].round() as i64..=end[along].round() as i64 {
        let centre = start[across] + slope * (step as f64 - start[along]);
        let low = centre.floor();
        for (at, share) in [(low, 1.0 - (centre - low)), (low + 1.0, centre - low)] {
            let mut point = [0; 2];
            (point[along], point[across]) = (step, at as i64);
            if point[0] as f64 >= min_x {
                blend(canvas, point, colour, opacity * share);
            }
        }
    }
}

fn dot(canvas: &mut RgbImage, at: [f64; 2], colour: Rgb<u8>) {
    if !at.iter().all(|along| along.abs() < 1e6) {
        return;
    }
    let [x, y] = at.map(|along| along.round() as i64);
    for dy in -2..=2i64 {
        for dx in -2..=2i64 {
            if dx * dx + dy * dy <= 5 {
                blend(canvas, [x + dx, y + dy], colour, 1.0);
            }
        }
    }
}

fn blend(canvas: &mut RgbImage, [x, y]: [i64; 2], colour: Rgb<u8>, opacity: f64) {
    let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else {
        return;
    };
    if let Some(pixel) = canvas.get_pixel_mut_checked(x, y) {
        for (channel, &wanted) in pixel.0.iter_mut().zip(&colour.0) {
            *channel =
                (f64::from(*channel) * (1.0 - opacity) + f64::from(wanted) * opacity).round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::MapPx;
    use grimnet_photo::{Metadata, PhotoPx};

    use super::*;
    use crate::outcome::MatchedPair;

    fn points(outline: Vec<[f64; 2]>) -> MatchedPoints {
        let pair = |from: [f64; 2], to: [f64; 2], is_inlier| MatchedPair {
            photo_px: PhotoPx::new(from[0], from[1]),
            map_px: MapPx::new(to[0], to[1]),
            is_inlier,
        };
        MatchedPoints {
            pairs: vec![
                pair([10.0, 10.0], [1050.0, 2050.0], true),
                pair([90.0, 50.0], [1300.0, 2300.0], false),
                pair([f64::NAN, 0.0], [1e300, 0.0], false),
            ],
            tile_map_px: WindowPx::new(1000.0, 2000.0, 512.0, 512.0),
            outline_map_px: outline.iter().map(|&[x, y]| MapPx::new(x, y)).collect(),
        }
    }

    #[test]
    fn matches_and_outline_are_drawn() {
        let photo = Photo::from_image(
            RgbImage::from_pixel(100, 60, Rgb([10, 20, 200])),
            Metadata::default(),
        );
        let outline = vec![
            [1100.0, 2100.0],
            [1400.0, 2100.0],
            [1400.0, 2300.0],
            [1100.0, 2300.0],
        ];
        let options = DrawOptions {
            height_px: 120,
            ..DrawOptions::default()
        };
        let picture = draw_matches(&photo, &points(outline), None, &options).unwrap();
        // 100 x 60 and a square tile, at height 120.
        assert_eq!(picture.dimensions(), (200 + GAP_PX + 120, 120));
        let count = |colour: Rgb<u8>| picture.pixels().filter(|pixel| **pixel == colour).count();
        assert!(count(INLIER) >= 30, "{}", count(INLIER));
        assert!(count(OUTLIER) >= 20);
        let near = |pixel: &Rgb<u8>| pixel[0] > 200 && pixel[1] > 160 && pixel[2] < 60;
        assert!(picture.pixels().filter(|pixel| near(pixel)).count() > 100);
        // The photo is visible.
        assert_eq!(picture.get_pixel(5, 100), &Rgb([10, 20, 200]));
    }

    #[test]
    fn a_large_outline_is_cut_off_alike_on_all_sides() {
        let outline = vec![[-1e6, -1e6], [1e6, -1e6], [1e6, 1e6], [-1e6, 1e6]];
        let window = map_window(&points(outline));
        // The middle of the tile.
        assert!((window.x + window.w / 2.0 - 1256.0).abs() < 1e-6);
        assert!((window.y + window.h / 2.0 - 2256.0).abs() < 1e-6);
    }

    #[test]
    fn outlines_that_are_not_finite_do_no_harm() {
        let photo = Photo::from_image(RgbImage::new(3, 900), Metadata::default());
        for corner in [f64::NAN, f64::INFINITY, -1e300, 1e9] {
            let outline = vec![[corner, 2100.0], [1400.0, corner], [1400.0, 2300.0]];
            assert!(draw_matches(&photo, &points(outline), None, &DrawOptions::default()).is_ok());
        }
    }
}
