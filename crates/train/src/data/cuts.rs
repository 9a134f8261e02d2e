//! Pairs cut from single pictures: both views show one picture, related by a random homography.

use super::homography::{apply, random_homography};
use super::layout::Fold;
use super::mapping::Mapping;
use super::pair::{Keypoints, Pair, PairOptions, Place, Source, Views};
use super::picture::Picture;
use super::pictures::{HeldOut, Pictures};
use super::resample::{pyramid_level, warp};
use super::scene::Scene;
use image::RgbImage;
use nalgebra::Matrix3;
use rand::Rng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

impl Source for Pictures {
    fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair> {
        group_of(self, Fold::Training, count, options, random)
    }

    fn scenes(&self) -> usize {
        Pictures::scenes(self)
    }
}

impl Source for HeldOut {
    fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair> {
        group_of(&self.0, Fold::Validation, count, options, random)
    }

    fn scenes(&self) -> usize {
        self.0.scenes()
    }
}

/// Pairs at windows of one picture that overlap little; only two of a small picture, then the next picture.
fn group_of(
    pictures: &Pictures,
    fold: Fold,
    count: usize,
    options: &PairOptions,
    random: &mut ChaCha8Rng,
) -> Vec<Pair> {
    let mut out: Vec<Pair> = Vec::with_capacity(count);
    let mut current: Option<(usize, std::sync::Arc<Picture>, Vec<Place>)> = None;
    let mut refused = 0;
    while out.len() < count && refused < 200 {
        let (index, picture, taken) = match current.take() {
            Some(current) => current,
            None => {
                let Some(&index) = pictures.fold(fold).choose(random) else {
                    break;
                };
                let Some(picture) = pictures.load(index) else {
                    refused += 1;
                    continue;
                };
                (index, picture, Vec::new())
            }
        };
        let window = choose_window(
            pictures.place_of(index),
            &picture,
            options.side_px,
            &taken,
            random,
        );
        let scene = pictures.scene(index);
        let other = other_view(pictures, fold, options, random);
        let Some(pair) = pair_at(&picture, window, scene, other, options, random) else {
            refused += 1;
            continue;
        };
        out.push(pair);
        let small = picture.size_px().0.min(picture.size_px().1) < 600;
        let mut taken = taken;
        taken.push(window);
        if taken.len() < if small { 2 } else { options.group } {
            current = Some((index, picture, taken));
        }
    }
    out
}

/// A random view of a random picture, if looks need one.
fn other_view(
    pictures: &Pictures,
    fold: Fold,
    options: &PairOptions,
    random: &mut ChaCha8Rng,
) -> Option<RgbImage> {
    if options.look.mixed == 0.0 {
        return None;
    }
    let index = *pictures.fold(fold).choose(random)?;
    let picture = pictures.load(index)?;
    let place = choose_window(index, &picture, options.side_px, &[], random);
    let picture_from_view = picture_from_window(&place, f64::from(options.side_px));
    Some(warp(&picture, &picture_from_view, options.side_px).0)
}

/// Homography from the pixels of a view of a window to those of the picture.
fn picture_from_window(place: &Place, side_px: f64) -> Matrix3<f64> {
    let [left, top, right, _] = place.window;
    let scale = (right - left) / side_px;
    // Pixel centres: picture = (view + 0.5) * scale - 0.5 + corner.
    Matrix3::new(
        scale,
        0.0,
        left + 0.5 * scale - 0.5,
        0.0,
        scale,
        top + 0.5 * scale - 0.5,
        0.0,
        0.0,
        1.0,
    )
}

/// A window of random scale; of several random windows, the one that overlaps least with those already taken.
pub(super) fn choose_window(
    picture_number: usize,
    picture: &Picture,
    side_px: u32,
    taken: &[Place],
    random: &mut ChaCha8Rng,
) -> Place {
    let (width, height) = picture.size_px();
    let (width, height) = (f64::from(width), f64::from(height));
    let short = width.min(height);
    // Source pixels per pixel of the view: limits enlargement to a factor of 1.7 and the window to the picture.
    let most = (short * 0.9 / f64::from(side_px)).min(2.6);
    let least = (short * 0.28 / f64::from(side_px))
        .clamp(0.6, 0.8)
        .min(most);
    let scale = if most > least {
        random.random_range(least.ln()..most.ln()).exp()
    } else {
        most
    };
    let side = scale * f64::from(side_px);
    let mut best: Option<(f64, Place)> = None;
    for _ in 0..if taken.is_empty() { 1 } else { 12 } {
        let x = random.random_range(0.0..=(width - side).max(0.0));
        let y = random.random_range(0.0..=(height - side).max(0.0));
        let place = Place {
            picture: picture_number,
            window: [x, y, x + side, y + side],
        };
        let overlap = taken.iter().map(|t| t.overlap(&place)).fold(0.0, f64::max);
        if best.is_none_or(|(least, _)| overlap < least) {
            best = Some((overlap, place));
        }
    }
    best.map_or(
        Place {
            picture: picture_number,
            window: [0.0, 0.0, side, side],
        },
        |(_, place)| place,
    )
}

/// One of the eight symmetries of a square, as a homography between its pixels.
pub(super) fn random_turn(side: f64, random: &mut impl Rng) -> Matrix3<f64> {
    let last = side - 1.0;
    let flip = if random.random() {
        Matrix3::new(-1.0, 0.0, last, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    } else {
        Matrix3::identity()
    };
    let turn = Matrix3::new(0.0, -1.0, last, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    (0..random.random_range(0..4)).fold(flip, |m, _| turn * m)
}

/// A pair at a window; `None` if the views share too few points.
pub(super) fn pair_at(
    picture: &Picture,
    place: Place,
    scene: Option<Scene>,
    other: Option<RgbImage>,
    options: &PairOptions,
    random: &mut ChaCha8Rng,
) -> Option<Pair> {
    let side = f64::from(options.side_px);
    let picture_from_sat = picture_from_window(&place, side) * random_turn(side, random);
    let (sat_plain, _) = warp(picture, &picture_from_sat, options.side_px);
    let uav_from_sat = random_homography(&options.homography, side, random);
    let sat_from_uav = uav_from_sat.try_inverse()?;
    let picture_from_uav = picture_from_sat * sat_from_uav;
    let (uav_plain, mut seen) = warp(picture, &picture_from_uav, options.side_px);
    if random.random_bool(options.black_corners) {
        cut_corners(&mut seen, options.side_px as usize, random);
    }
    let known = [picture_from_sat, picture_from_uav].map(|m| keypoints_of(picture, &m, side));
    let keypoints = match known {
        [Some(in_sat), Some(in_uav)] => Keypoints::Known([in_sat, in_uav]),
        _ => Keypoints::Corners,
    };
    Views {
        plain: [sat_plain, uav_plain],
        seen,
        uav_from_sat,
        mapping: Mapping::plane(uav_from_sat)?,
        place,
        scene,
        keypoints,
        other,
    }
    .finish(options, random)
}

/// The picture's known keypoints in view pixels, those of the pyramid level that the view is cut from.
fn keypoints_of(
    picture: &Picture,
    picture_from_view: &Matrix3<f64>,
    side_px: f64,
) -> Option<Vec<[f64; 2]>> {
    let level = pyramid_level(picture_from_view, side_px);
    let view_from_picture = picture_from_view.try_inverse()?;
    let points = picture.keypoints(level)?;
    Some(
        points
            .iter()
            .map(|at| apply(&view_from_picture, at.map(f64::from)))
            .collect(),
    )
}

/// Marks the pixels outside a rotated rectangular frame as not seen: photos are wider than high and need not fill a tile.
pub(super) fn cut_corners(seen: &mut [bool], side: usize, random: &mut impl Rng) {
    let (sin, cos) = random.random_range(0.0..std::f32::consts::PI).sin_cos();
    let long = random.random_range(0.42..0.75) * side as f32;
    let half = [long, long * random.random_range(0.55..1.0)];
    let c = side as f32 / 2.0;
    for y in 0..side {
        for x in 0..side {
            let (dx, dy) = (x as f32 - c, y as f32 - c);
            if (cos * dx + sin * dy).abs() > half[0] || (cos * dy - sin * dx).abs() > half[1] {
                seen[y * side + x] = false;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell_labels::LABEL_NONE;
    use super::super::counterpart::Counterpart;
    use super::super::homography::HomographyRange;
    use super::*;
    use rand::SeedableRng;

    fn picture() -> Picture {
        let image = RgbImage::from_fn(300, 320, |x, y| {
            let v = if ((x / 13) * 7 + (y / 11) * 5) % 6 < 3 {
                60
            } else {
                190
            };
            image::Rgb([v, v.wrapping_add((x % 30) as u8), 90])
        });
        Picture::new(image)
    }

    #[test]
    fn points_and_labels_agree_with_the_homography() {
        let options = PairOptions {
            side_px: 128,
            points: 40,
            ..PairOptions::default()
        };
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let picture = picture();
        let mut pairs = 0;
        for _ in 0..20 {
            let place = choose_window(0, &picture, 128, &[], &mut random);
            let Some(pair) = pair_at(&picture, place, None, None, &options, &mut random) else {
                continue;
            };
            pairs += 1;
            assert_eq!(pair.sat_points.len(), 40);
            for (a, b) in pair.sat_points.iter().zip(&pair.uav_points) {
                let [x, y] = apply(&pair.uav_from_sat_px, a.map(f64::from));
                assert!((x - f64::from(b[0])).abs() < 1e-3 && (y - f64::from(b[1])).abs() < 1e-3);
            }
            assert!(
                pair.uav_labels
                    .iter()
                    .zip(&pair.uav_seen)
                    .all(|(label, seen)| *seen || *label == LABEL_NONE)
            );
            assert!(pair.sat_labels.iter().any(|label| *label != LABEL_NONE));
        }
        assert!(pairs > 10);
    }

    /// Without differences between the views, corresponding pixels have equal colours.
    #[test]
    fn views_show_the_same_ground() {
        let range = HomographyRange {
            rotation_deg: 20.0,
            log_scale: 0.1,
            log_stretch: 0.0,
            shift: 0.05,
            corner: 0.02,
        };
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        let picture = Picture::new(RgbImage::from_fn(400, 400, |x, y| {
            image::Rgb([
                (128.0 + 100.0 * (x as f32 / 30.0).sin()) as u8,
                (128.0 + 100.0 * (y as f32 / 25.0).cos()) as u8,
                0,
            ])
        }));
        let to_sat = Matrix3::new(1.3, 0.0, 40.0, 0.0, 1.3, 30.0, 0.0, 0.0, 1.0);
        let h = random_homography(&range, 128.0, &mut random);
        let (sat, _) = warp(&picture, &to_sat, 128);
        let (uav, seen) = warp(&picture, &(to_sat * h.try_inverse().unwrap()), 128);
        let mut compared = 0;
        for y in 0..128 {
            for x in 0..128 {
                let plane = Mapping::plane(h).unwrap();
                if let Counterpart::At([u, v]) =
                    plane.uav_from_sat([f64::from(x), f64::from(y)], 128.0, 1.0)
                {
                    let (u, v) = (u.round() as u32, v.round() as u32);
                    if seen[(v * 128 + u) as usize] {
                        let (a, b) = (sat.get_pixel(x, y), uav.get_pixel(u, v));
                        assert!(
                            a.0.iter().zip(&b.0).all(|(a, b)| a.abs_diff(*b) < 12),
                            "{a:?} {b:?}"
                        );
                        compared += 1;
                    }
                }
            }
        }
        assert!(compared > 4000);
    }
}
