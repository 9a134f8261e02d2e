//! One training pair and the group of pairs that it comes in.

use super::corners::corners;
use super::homography::{HomographyRange, random_homography};
use super::mapping::{Mapping, Seen};
use super::photometric::{Look, change_look};
use super::pictures::{Aside, Fold, Picture, Pictures};
use super::resample::warp;
use grimnet_net::Domain;
use image::RgbImage;
use nalgebra::Matrix3;
use rand::Rng;
use rand::seq::{IndexedRandom, SliceRandom};
use serde::{Deserialize, Serialize};

/// The label of a cell without a keypoint; the others are `8 * row + column` inside the cell.
pub const LABEL_NONE: u8 = 64;

/// How pairs are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PairOptions {
    /// Side of both views, pixels; a multiple of 32.
    pub side_px: u32,
    /// Windows taken from one picture: hard negatives of each other.
    pub group: usize,
    /// Points compared by the descriptor loss.
    pub points: usize,
    /// Share of pairs whose photo has black corners where the picture ends or a rotated frame would.
    pub black_corners: f64,
    /// Difference of the views.
    pub homography: HomographyRange,
    /// Difference of their looks.
    pub look: Look,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            side_px: 224,
            group: 4,
            points: 256,
            black_corners: 0.3,
            homography: HomographyRange::default(),
            look: Look::default(),
        }
    }
}

/// Where a view lies: pairs of overlapping places are no negatives of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Index of the picture.
    pub picture: usize,
    /// Left, top, right, bottom in the picture's pixels.
    pub window_px: [f64; 4],
}

impl Place {
    /// Share of the smaller window that the other covers.
    pub fn overlap(&self, other: &Place) -> f64 {
        if self.picture != other.picture {
            return 0.0;
        }
        let (a, b) = (self.window_px, other.window_px);
        let w = (a[2].min(b[2]) - a[0].max(b[0])).max(0.0);
        let h = (a[3].min(b[3]) - a[1].max(b[1])).max(0.0);
        let area = |r: [f64; 4]| (r[2] - r[0]) * (r[3] - r[1]);
        w * h / area(a).min(area(b)).max(1e-9)
    }
}

/// Two views of one place, with truth.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The map's view.
    pub sat: RgbImage,
    /// The drone's view.
    pub uav: RgbImage,
    /// For each 8 x 8 cell of the drone's view, whether all of it lies inside the picture.
    pub uav_seen: Vec<bool>,
    /// Keypoint label of each cell of the map's view.
    pub sat_labels: Vec<u8>,
    /// Keypoint label of each cell of the drone's view.
    pub uav_labels: Vec<u8>,
    /// Points of the map's view, pixels (x, y).
    pub sat_points: Vec<[f32; 2]>,
    /// The same points in the drone's view.
    pub uav_points: Vec<[f32; 2]>,
    /// From the map's view's pixels to the drone's view's, of points on the ground.
    pub uav_from_sat_px: Matrix3<f64>,
    /// The exact relation of the views.
    pub mapping: Mapping,
    /// Where the map's view lies.
    pub place: Place,
}

/// Something that gives groups of pairs.
pub trait Source: Send + Sync {
    /// `count` pairs, near each other where that makes hard negatives.
    fn group(
        &self,
        count: usize,
        options: &PairOptions,
        random: &mut rand_chacha::ChaCha8Rng,
    ) -> Vec<Pair>;
}

/// Pairs from single pictures.
impl Source for Pictures {
    fn group(
        &self,
        count: usize,
        options: &PairOptions,
        random: &mut rand_chacha::ChaCha8Rng,
    ) -> Vec<Pair> {
        group_of(self, Fold::Training, count, options, random)
    }
}

impl Source for Aside {
    fn group(
        &self,
        count: usize,
        options: &PairOptions,
        random: &mut rand_chacha::ChaCha8Rng,
    ) -> Vec<Pair> {
        group_of(&self.0, Fold::Validation, count, options, random)
    }
}

/// Windows of one picture that lie apart; of a small picture only two, then the next picture.
pub(super) fn group_of(
    pictures: &Pictures,
    fold: Fold,
    count: usize,
    options: &PairOptions,
    random: &mut rand_chacha::ChaCha8Rng,
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
        let window = choose_window(index, &picture, options.side_px, &taken, random);
        let Some(pair) = pair_at(&picture, window, options, random) else {
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

/// A window whose scale suits the picture, as far from those already taken as some tries find.
fn choose_window(
    index: usize,
    picture: &Picture,
    side_px: u32,
    taken: &[Place],
    random: &mut rand_chacha::ChaCha8Rng,
) -> Place {
    let (width, height) = picture.size_px();
    let (width, height) = (f64::from(width), f64::from(height));
    let short = width.min(height);
    // Source pixels per pixel of the view: never enlarged more than 1.7 times, never more than the picture holds.
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
            picture: index,
            window_px: [x, y, x + side, y + side],
        };
        let overlap = taken.iter().map(|t| t.overlap(&place)).fold(0.0, f64::max);
        if best.is_none_or(|(least, _)| overlap < least) {
            best = Some((overlap, place));
        }
    }
    best.map_or(
        Place {
            picture: index,
            window_px: [0.0, 0.0, side, side],
        },
        |(_, place)| place,
    )
}

/// One of the eight turns and mirrorings of a square of that side, as view pixels from view pixels.
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

/// A pair at a window; `None` where too few points are seen in both views.
pub(super) fn pair_at(
    picture: &Picture,
    place: Place,
    options: &PairOptions,
    random: &mut rand_chacha::ChaCha8Rng,
) -> Option<Pair> {
    let side = f64::from(options.side_px);
    let [left, top, right, _] = place.window_px;
    let scale = (right - left) / side;
    // Pixel centres: picture = (view + 0.5) * scale - 0.5 + corner.
    let picture_from_window = Matrix3::new(
        scale,
        0.0,
        left + 0.5 * scale - 0.5,
        0.0,
        scale,
        top + 0.5 * scale - 0.5,
        0.0,
        0.0,
        1.0,
    );
    let picture_from_sat = picture_from_window * random_turn(side, random);
    let (sat_plain, _) = warp(picture, &picture_from_sat, options.side_px);
    let uav_from_sat = random_homography(&options.homography, side, random);
    let sat_from_uav = uav_from_sat.try_inverse()?;
    let (uav_plain, mut seen) = warp(picture, &(picture_from_sat * sat_from_uav), options.side_px);
    if random.random_bool(options.black_corners) {
        cut_corners(&mut seen, options.side_px as usize, random);
    }
    finish(
        [sat_plain, uav_plain],
        seen,
        uav_from_sat,
        Mapping::plane(uav_from_sat)?,
        place,
        options,
        random,
    )
}

/// What a rotated frame leaves unseen.
pub(super) fn cut_corners(seen: &mut [bool], side: usize, random: &mut impl Rng) {
    let (sin, cos) = random
        .random_range(0.0..std::f32::consts::FRAC_PI_2)
        .sin_cos();
    let half = [
        random.random_range(0.42..0.75) * side as f32,
        random.random_range(0.42..0.75) * side as f32,
    ];
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

/// Looks, labels and points of two plain views.
pub(super) fn finish(
    [sat_plain, uav_plain]: [RgbImage; 2],
    seen: Vec<bool>,
    uav_from_sat: Matrix3<f64>,
    mapping: Mapping,
    place: Place,
    options: &PairOptions,
    random: &mut rand_chacha::ChaCha8Rng,
) -> Option<Pair> {
    let side = options.side_px as usize;
    let cells = side / 8;
    let uav_seen: Vec<bool> = (0..cells * cells)
        .map(|cell| {
            let (cy, cx) = (cell / cells, cell % cells);
            (0..8).all(|y| (0..8).all(|x| seen[(cy * 8 + y) * side + cx * 8 + x]))
        })
        .collect();
    let sees = |[x, y]: [f64; 2]| uav_seen[(y as usize / 8) * cells + x as usize / 8];
    // Points of both views: one at a random place of each of some cells of the map's view.
    let mut order: Vec<usize> = (0..cells * cells).collect();
    order.shuffle(random);
    let (mut sat_points, mut uav_points) = (Vec::new(), Vec::new());
    for cell in order {
        let at = [
            (cell % cells * 8) as f64 + random.random_range(-0.5..7.5),
            (cell / cells * 8) as f64 + random.random_range(-0.5..7.5),
        ];
        if let Seen::At(there) = mapping.uav_from_sat(at, side as f64, 3.0)
            && sees(there)
        {
            sat_points.push(at.map(|v| v as f32));
            uav_points.push(there.map(|v| v as f32));
            if sat_points.len() == options.points {
                break;
            }
        }
    }
    if sat_points.len() < options.points {
        return None;
    }
    let sat = change_look(&sat_plain, Domain::Sat, &options.look, random);
    let mut uav = change_look(&uav_plain, Domain::Uav, &options.look, random);
    let (sat_labels, uav_labels) =
        surviving_corners([&sat_plain, &uav_plain], [&sat, &uav], &uav_seen, &mapping);
    for (pixel, seen) in uav.pixels_mut().zip(&seen) {
        if !seen {
            pixel.0 = [0; 3];
        }
    }
    Some(Pair {
        sat,
        uav,
        uav_seen,
        sat_labels,
        uav_labels,
        sat_points,
        uav_points,
        uav_from_sat_px: uav_from_sat,
        mapping,
        place,
    })
}

/// Corners closer than this, mapped, are the same.
const SAME_CORNER_PX: f64 = 2.0;

/// A bitmap of places within [`SAME_CORNER_PX`] of a corner.
fn near_corners(found: &[[usize; 2]], side: usize) -> Vec<bool> {
    let mut near = vec![false; side * side];
    let reach = SAME_CORNER_PX as usize;
    for &[x, y] in found {
        for yy in y.saturating_sub(reach)..=(y + reach).min(side - 1) {
            for xx in x.saturating_sub(reach)..=(x + reach).min(side - 1) {
                near[yy * side + xx] = true;
            }
        }
    }
    near
}

/// Labels from corners that survive: found in the plain map view, in the map view's other look, and (where both views
/// see the place) in the photo. Where only one view sees a place, that view's corner counts.
fn surviving_corners(
    [sat_plain, uav_plain]: [&RgbImage; 2],
    [sat, uav]: [&RgbImage; 2],
    uav_seen: &[bool],
    mapping: &Mapping,
) -> (Vec<u8>, Vec<u8>) {
    const MOST: usize = 600;
    let side = sat.width() as usize;
    let cells = side / 8;
    let found = corners(sat_plain, 3, MOST);
    let in_sat = near_corners(&corners(sat, 2, MOST), side);
    let uav_corners = corners(uav, 2, MOST);
    let in_uav = near_corners(&uav_corners, side);
    let (mut sat_labels, mut uav_labels) = (
        vec![LABEL_NONE; cells * cells],
        vec![LABEL_NONE; cells * cells],
    );
    let set = |labels: &mut [u8], x: usize, y: usize| {
        let label = &mut labels[(y / 8) * cells + x / 8];
        if *label == LABEL_NONE {
            *label = ((y % 8) * 8 + x % 8) as u8;
        }
    };
    for [x, y] in found {
        if !in_sat[y * side + x] {
            continue;
        }
        match mapping.uav_from_sat([x as f64, y as f64], side as f64, 1.0) {
            Seen::At([u, v]) => {
                let (u, v) = (u.round() as usize, v.round() as usize);
                if uav_seen[(v / 8) * cells + u / 8] {
                    if in_uav[v * side + u] {
                        set(&mut sat_labels, x, y);
                        set(&mut uav_labels, u, v);
                    }
                } else {
                    set(&mut sat_labels, x, y);
                }
            }
            Seen::Outside => set(&mut sat_labels, x, y),
            Seen::Hidden => {}
        }
    }
    let in_plain = near_corners(&corners(uav_plain, 2, MOST), side);
    for [x, y] in uav_corners {
        let unseen_by_sat =
            mapping.sat_from_uav([x as f64, y as f64], side as f64, 1.0) == Seen::Outside;
        if unseen_by_sat && in_plain[y * side + x] && uav_seen[(y / 8) * cells + x / 8] {
            set(&mut uav_labels, x, y);
        }
    }
    (sat_labels, uav_labels)
}

#[cfg(test)]
mod tests {
    use super::super::homography::apply;
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
            let Some(pair) = pair_at(&picture, place, &options, &mut random) else {
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

    /// With no difference between the views, a map pixel and its photo pixel show the same thing.
    #[test]
    fn views_show_the_same_ground() {
        let none = HomographyRange {
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
        let h = random_homography(&none, 128.0, &mut random);
        let (sat, _) = warp(&picture, &to_sat, 128);
        let (uav, seen) = warp(&picture, &(to_sat * h.try_inverse().unwrap()), 128);
        let mut compared = 0;
        for y in 0..128 {
            for x in 0..128 {
                let plane = Mapping::plane(h).unwrap();
                if let Seen::At([u, v]) =
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
