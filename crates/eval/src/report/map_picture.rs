//! The map with true positions and answers drawn on it.

use grimnet_geo::{GeoError, LonLat, Raster, WindowPx};
use image::{Rgb, RgbImage};

/// Longest side of the picture, pixels.
const SIDE_PX: f64 = 1000.0;
/// A true position.
const TRUE_COLOUR: Rgb<u8> = Rgb([40, 220, 60]);
/// An answer.
const ANSWER_COLOUR: Rgb<u8> = Rgb([255, 60, 40]);
/// A true position without an answer.
const MISS_COLOUR: Rgb<u8> = Rgb([255, 220, 0]);

/// One photo on the map.
#[derive(Debug, Clone, Copy)]
pub struct Mark {
    /// True position.
    pub truth: LonLat,
    /// Position of the fix, if there is one.
    pub answer: Option<LonLat>,
}

/// Draws the whole map at reduced size: true positions in green, fixes in red, a line between the two, misses in yellow.
///
/// # Errors
/// The map cannot be read.
pub fn draw(map: &dyn Raster, marks: &[Mark]) -> Result<RgbImage, GeoError> {
    let (width, height) = map.size_px();
    let (width, height) = (width as f64, height as f64);
    let scale = (SIDE_PX / width.max(height)).min(1.0);
    let window = WindowPx {
        x: 0.0,
        y: 0.0,
        w: width,
        h: height,
    };
    let sides = [width, height].map(|side| ((side * scale).round() as u32).max(1));
    let mut picture = map.read(window, sides[0], sides[1])?.rgb;
    // Darkened, so that marks are visible on any map.
    for value in picture.iter_mut() {
        *value = 64 + *value / 2;
    }
    let at = |place: LonLat| {
        let px = map.georeference().map_px_from_lonlat(place).ok()?;
        Some([px.x * scale, px.y * scale])
    };
    for mark in marks {
        let Some(truth) = at(mark.truth) else {
            continue;
        };
        let Some(answer) = mark.answer.and_then(at) else {
            disc(&mut picture, truth, 5.0, MISS_COLOUR);
            continue;
        };
        line(&mut picture, truth, answer, ANSWER_COLOUR);
        disc(&mut picture, truth, 4.5, TRUE_COLOUR);
        disc(&mut picture, answer, 2.5, ANSWER_COLOUR);
    }
    Ok(picture)
}

fn disc(picture: &mut RgbImage, [x, y]: [f64; 2], radius: f64, colour: Rgb<u8>) {
    let reach = radius.ceil() as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            if (dx as f64).hypot(dy as f64) <= radius {
                put(picture, x + dx as f64, y + dy as f64, colour);
            }
        }
    }
}

fn line(picture: &mut RgbImage, from: [f64; 2], to: [f64; 2], colour: Rgb<u8>) {
    let steps = (to[0] - from[0])
        .hypot(to[1] - from[1])
        .ceil()
        .clamp(1.0, 1e5);
    for i in 0..=steps as u32 {
        let t = f64::from(i) / steps;
        let along = |axis: usize| from[axis] + t * (to[axis] - from[axis]);
        put(picture, along(0), along(1), colour);
    }
}

fn put(picture: &mut RgbImage, x: f64, y: f64, colour: Rgb<u8>) {
    let (x, y) = (x.floor(), y.floor());
    if x >= 0.0 && y >= 0.0 && x < f64::from(picture.width()) && y < f64::from(picture.height()) {
        picture.put_pixel(x as u32, y as u32, colour);
    }
}
