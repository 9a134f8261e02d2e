//! Synthetic shapes whose corners are known exactly, for the first training of a keypoint detector (MagicPoint; DeTone et al.
//! 2018, section 4).

mod canvas;
mod figure;

use super::cuts::{choose_window, pair_at};
use super::pair::{Pair, PairOptions, Source};
use super::photometric::Look;
use super::picture::Picture;
use canvas::Canvas;
use figure::{Brush, Figure};
use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// Side of a picture as a multiple of the side of a view.
const PICTURE_PER_VIEW: f64 = 2.1;
/// Radius of the disc that contains a figure, pixels.
const RADIUS_PX: [f64; 2] = [24.0, 110.0];
/// Random positions for figures; figures that would overlap others are dropped.
const TRIES: usize = 60;
/// Share of pictures that consist of noise without corners.
const NOISE: f64 = 0.06;
/// Largest change of the background brightness across a picture.
const SLOPE: f32 = 0.12;

/// A source that draws a new picture for each pair.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shapes;

impl Shapes {
    /// A picture of `side_px` x `side_px` with its corners as keypoints. Figures do not overlap, since occlusion would make
    /// additional corners.
    pub fn picture(side_px: u32, random: &mut ChaCha8Rng) -> Picture {
        let side = f64::from(side_px);
        let ground: f32 = random.random_range(0.1..0.9);
        if random.random_bool(NOISE) {
            return Picture::new(noise(side_px, ground, random).into_image())
                .with_keypoints(vec![Vec::new()]);
        }
        let mut canvas = sloped(side_px, ground, random);
        let (mut discs, mut corners) = (Vec::<([f64; 2], f64)>::new(), Vec::new());
        for _ in 0..TRIES {
            let radius_px = random
                .random_range(RADIUS_PX[0].ln()..RADIUS_PX[1].ln())
                .exp();
            let centre = [(); 2].map(|()| random.random_range(0.0..side));
            let apart = |(other, r): &([f64; 2], f64)| {
                (centre[0] - other[0]).hypot(centre[1] - other[1]) > radius_px + r + 4.0
            };
            let Some(figure) = Figure::ALL
                .choose(random)
                .filter(|_| discs.iter().all(apart))
            else {
                continue;
            };
            discs.push((centre, radius_px));
            let mut brush = Brush {
                centre,
                radius_px,
                ground,
                random,
            };
            corners.extend(figure.draw(&mut canvas, &mut brush));
        }
        let inside = |at: &[f64; 2]| at.iter().all(|v| (0.0..side - 1.0).contains(v));
        let corners = corners.into_iter().filter(inside);
        Picture::new(canvas.into_image())
            .with_keypoints(vec![corners.map(|at| at.map(|v| v as f32)).collect()])
    }
}

/// A background with a brightness gradient.
fn sloped(side_px: u32, ground: f32, random: &mut ChaCha8Rng) -> Canvas {
    let (sin, cos) = random.random_range(0.0..std::f32::consts::TAU).sin_cos();
    let slope = random.random_range(0.0..SLOPE) / side_px as f32;
    let tint = [(); 3].map(|()| random.random_range(-0.06f32..0.06));
    let half = side_px as f32 / 2.0;
    Canvas::new(side_px as usize, |[x, y]| {
        let rise = (cos * (x - half) + sin * (y - half)) * slope;
        tint.map(|t| ground + t + rise)
    })
}

/// Independent random brightness at every pixel.
fn noise(side_px: u32, ground: f32, random: &mut ChaCha8Rng) -> Canvas {
    let spread = random.random_range(0.05..0.4f32);
    let side = side_px as usize;
    let grain: Vec<f32> = (0..side * side)
        .map(|_| random.random_range(-spread..spread))
        .collect();
    Canvas::new(side, |[x, y]| {
        [ground + grain[y as usize * side + x as usize]; 3]
    })
}

impl Source for Shapes {
    fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair> {
        // Shadows would add corners.
        let options = PairOptions {
            look: Look {
                shadows: 0.0,
                ..options.look
            },
            ..options.clone()
        };
        let side_px = (f64::from(options.side_px) * PICTURE_PER_VIEW) as u32;
        let one = |random: &mut ChaCha8Rng| {
            let picture = Self::picture(side_px, random);
            let index = random.random::<u32>() as usize;
            let window = choose_window(index, &picture, options.side_px, &[], random);
            pair_at(&picture, window, None, None, &options, random)
        };
        (0..4 * count)
            .filter_map(|_| one(random))
            .take(count)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::LABEL_NONE;
    use crate::data::corners::corners;
    use rand::SeedableRng;

    /// A figure on a uniform background, and its corners.
    fn alone(figure: Figure, seed: u64) -> (image::RgbImage, Vec<[f64; 2]>) {
        let mut canvas = Canvas::new(200, |_| [0.5; 3]);
        let corners = figure.draw(
            &mut canvas,
            &mut Brush {
                centre: [100.0, 98.0],
                radius_px: 80.0,
                ground: 0.5,
                random: &mut ChaCha8Rng::seed_from_u64(seed),
            },
        );
        (canvas.into_image(), corners)
    }

    fn nearest(at: [f64; 2], points: &[[f64; 2]]) -> f64 {
        points
            .iter()
            .map(|p| (p[0] - at[0]).hypot(p[1] - at[1]))
            .fold(f64::MAX, f64::min)
    }

    /// The labels and the corners of Shi and Tomasi agree: two independent methods.
    #[test]
    fn labels_are_where_the_structure_tensor_has_corners() {
        for figure in Figure::ALL.into_iter().filter(|f| *f != Figure::Ellipse) {
            for seed in 0..12 {
                let (image, labels) = alone(figure, seed);
                let found: Vec<[f64; 2]> = corners(&image, 3, 200)
                    .into_iter()
                    .map(|at| at.map(|v| v as f64))
                    .collect();
                for label in &labels {
                    let off = nearest(*label, &found);
                    assert!(
                        off < 4.0,
                        "{figure:?} {seed}: no corner within {off} px of {label:?}"
                    );
                }
                // The rays of a star separate at some distance from its centre.
                let reach = if figure == Figure::Star { 8.0 } else { 5.0 };
                for corner in found.iter().take(labels.len()) {
                    let off = nearest(*corner, &labels);
                    assert!(
                        off < reach,
                        "{figure:?} {seed}: no label within {off} px of {corner:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn ellipses_and_noise_have_no_corners() {
        assert!(alone(Figure::Ellipse, 1).1.is_empty());
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let pictures: Vec<Picture> = (0..60).map(|_| Shapes::picture(128, &mut random)).collect();
        let none = pictures
            .iter()
            .filter(|picture| picture.keypoints(0).is_some_and(<[_]>::is_empty));
        assert!(none.count() >= 1);
    }

    /// After cutting, homography and rounding, labelled pixels of both views are at corners of the drawn figures.
    #[test]
    fn labels_follow_the_homography_into_both_views() {
        let plain = Look {
            sat_strength: 0.0,
            uav_strength: 0.0,
            equalised: 0.0,
            haze: 0.0,
            season: 0.0,
            jpeg: 0.0,
            ..Look::default()
        };
        let options = PairOptions {
            side_px: 160,
            points: 32,
            black_corners: 0.0,
            look: plain,
            ..PairOptions::default()
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let (mut near, mut all) = (0, 0);
        for pair in Shapes.group(12, &options, &mut random) {
            for (view, labels) in [(&pair.sat, &pair.sat_labels), (&pair.uav, &pair.uav_labels)] {
                let found: Vec<[f64; 2]> = corners(view, 2, 400)
                    .into_iter()
                    .map(|at| at.map(|v| v as f64))
                    .collect();
                for (cell, label) in labels.iter().enumerate().filter(|(_, l)| **l != LABEL_NONE) {
                    let label = usize::from(*label);
                    let at = [cell % 20 * 8 + label % 8, cell / 20 * 8 + label / 8];
                    let at = at.map(|v| v as f64);
                    // The structure tensor is not defined near the edge.
                    if at.iter().all(|v| (6.0..154.0).contains(v)) {
                        all += 1;
                        near += i32::from(nearest(at, &found) < 4.0);
                    }
                }
            }
        }
        assert!(all > 150, "{all}");
        assert!(f64::from(near) > 0.93 * f64::from(all), "{near} of {all}");
    }
}
