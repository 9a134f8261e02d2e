//! Homographic adaptation (DeTone et al. 2018, section 5): the detector runs on many random homographies of a picture, here also
//! under photometric changes of both domains. Points that it detects repeatedly become keypoints.

use super::homography::{apply, random_homography};
use super::label_options::LabelOptions;
use super::labels::Labels;
use super::pair::{black_outside, seen_cells};
use super::peaks::peaks;
use super::photometric::change_look;
use super::picture::Picture;
use super::resample::warp;
use crate::error::TrainError;
use grimnet_net::Domain;
use image::RgbImage;
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Views in a batch: half of them as maps, half as photos.
const TOGETHER: usize = 8;
/// Least distance of keypoints from the edge of the picture: views show nothing beyond it.
const MARGIN_PX: usize = 4;
/// A keypoint is placed at the centre of mass of the probabilities within this distance of their peak.
const REFINE_PX: usize = 2;

/// An input of a detector.
pub struct View {
    /// A square picture; black outside the original.
    pub image: RgbImage,
    /// For each 8 x 8 cell, whether all of it is inside the original picture.
    pub seen: Vec<bool>,
    /// The domain whose photometric changes it has.
    pub domain: Domain,
}

/// A keypoint detector.
pub trait Detect: Sync {
    /// Keypoint probabilities of the pixels of each view, row by row. The views have one size, and the views of a domain are
    /// consecutive.
    ///
    /// # Errors
    /// Returns an error if the network cannot be run.
    fn probabilities(&self, views: &[View]) -> Result<Vec<Vec<f32>>, TrainError>;
}

/// Probabilities of the pixels of a pyramid level, summed over the views that contain them.
struct Heat {
    width: usize,
    sum: Vec<f32>,
    count: Vec<u32>,
}

impl Heat {
    fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            sum: vec![0.0; width * height],
            count: vec![0; width * height],
        }
    }

    /// Adds the probabilities of a view by bilinear interpolation; cells outside the picture are ignored.
    fn add(&mut self, found: &[f32], view: &View, relation: &Relation) {
        let side = view.image.width() as usize;
        let last = (side - 1) as f64;
        let corners = [[0.0, 0.0], [last, 0.0], [last, last], [0.0, last]]
            .map(|corner| apply(&relation.level_from_view, corner));
        let height = self.sum.len() / self.width;
        let range = |axis: usize, size: usize| {
            let values = corners.map(|corner| corner[axis]);
            let (low, high) = (
                values.iter().copied().fold(f64::MAX, f64::min),
                values.iter().copied().fold(f64::MIN, f64::max),
            );
            let limit = size as f64;
            low.ceil().clamp(0.0, limit) as usize..(high.floor() + 1.0).clamp(0.0, limit) as usize
        };
        for y in range(1, height) {
            for x in range(0, self.width) {
                let [u, v] = apply(&relation.view_from_level, [x as f64, y as f64]);
                if !((0.0..last).contains(&u) && (0.0..last).contains(&v)) {
                    continue;
                }
                let (iu, iv) = (u as usize, v as usize);
                if !view.seen[(iv / 8) * (side / 8) + iu / 8] {
                    continue;
                }
                let (au, av) = ((u - iu as f64) as f32, (v - iv as f64) as f32);
                let row = |i: usize| {
                    let at = i * side + iu;
                    found[at] + au * (found[at + 1] - found[at])
                };
                self.sum[y * self.width + x] += row(iv) + av * (row(iv + 1) - row(iv));
                self.count[y * self.width + x] += 1;
            }
        }
    }

    /// Mean probabilities; 0 for pixels that no view contains.
    fn into_mean(self) -> Vec<f32> {
        let mean = |(sum, count): (f32, u32)| sum / count.max(1) as f32;
        self.sum.into_iter().zip(self.count).map(mean).collect()
    }
}

/// The keypoints of each pyramid level of a picture.
///
/// # Errors
/// Errors of the detector.
pub fn adapt(
    picture: &Picture,
    options: &LabelOptions,
    detector: &dyn Detect,
) -> Result<Labels, TrainError> {
    let mut levels = Vec::with_capacity(picture.levels());
    for level in 0..picture.levels() {
        let mut random = ChaCha8Rng::seed_from_u64(options.seed);
        random.set_stream(level as u64);
        let found = adapt_level(picture, level, options, detector, &mut random)?;
        levels.push(found);
    }
    Ok(Labels { levels })
}

fn adapt_level(
    picture: &Picture,
    level: usize,
    options: &LabelOptions,
    detector: &dyn Detect,
    random: &mut ChaCha8Rng,
) -> Result<Vec<[f32; 3]>, TrainError> {
    let (image, _) = picture.level(level);
    let (width, height) = (image.width() as usize, image.height() as usize);
    let side_px = image.width().max(image.height()).next_multiple_of(32);
    let side_px = side_px.min(options.side_px);
    let shrink = f64::from(1u32 << level);
    let picture_from_level = scale_and_shift(shrink, [0.5 * shrink - 0.5; 2]);
    let mut heat = Heat::new(width, height);
    for corner in windows(width, height, f64::from(side_px)) {
        let window = Window {
            picture,
            picture_from_level,
            level_from_window: scale_and_shift(1.0, corner),
            side_px,
        };
        for first in (0..options.views).step_by(TOGETHER) {
            let numbers = first..(first + TOGETHER).min(options.views);
            let (ways, views): (Vec<_>, Vec<_>) = numbers
                .filter_map(|i| window.view(i, options, random))
                .unzip();
            let found = detector.probabilities(&views)?;
            for ((found, view), way) in found.iter().zip(&views).zip(&ways) {
                heat.add(found, view, way);
            }
        }
    }
    let mean = heat.into_mean();
    let found = peaks(
        &mean,
        width,
        options.nms_radius_px,
        MARGIN_PX,
        options.threshold,
    );
    let label = |(score, at)| {
        let [x, y] = apply(&picture_from_level, centre_of_mass(&mean, width, at));
        [x as f32, y as f32, score]
    };
    Ok(found.into_iter().map(label).collect())
}

/// A square window of a pyramid level.
struct Window<'a> {
    picture: &'a Picture,
    picture_from_level: Matrix3<f64>,
    level_from_window: Matrix3<f64>,
    side_px: u32,
}

impl Window<'_> {
    /// View number `i` and its relation to the level; view 0 is the unchanged window. `None` if the homography is not
    /// invertible.
    fn view(
        &self,
        i: usize,
        options: &LabelOptions,
        random: &mut ChaCha8Rng,
    ) -> Option<(Relation, View)> {
        let domain = if i % TOGETHER < TOGETHER / 2 {
            Domain::Sat
        } else {
            Domain::Uav
        };
        let side = f64::from(self.side_px);
        let plain = i == 0;
        let window_from_view = if plain {
            Matrix3::identity()
        } else {
            random_homography(&options.homography, side, random)
        };
        let level_from_view = self.level_from_window * window_from_view;
        let picture_from_view = self.picture_from_level * level_from_view;
        let (mut image, seen) = warp(self.picture, &picture_from_view, self.side_px);
        if !plain {
            image = change_look(&image, None, domain, &options.look, random);
            black_outside(&mut image, &seen);
        }
        let way = Relation {
            view_from_level: level_from_view.try_inverse()?,
            level_from_view,
        };
        let view = View {
            image,
            seen: seen_cells(&seen, self.side_px as usize),
            domain,
        };
        Some((way, view))
    }
}

/// The homographies between a view and its level.
struct Relation {
    level_from_view: Matrix3<f64>,
    view_from_level: Matrix3<f64>,
}

/// Top-left corners of windows that cover a picture; one centred window if the picture is smaller.
fn windows(width: usize, height: usize, side: f64) -> Vec<[f64; 2]> {
    let starts = |size: usize| -> Vec<f64> {
        let free = size as f64 - side;
        if free <= 0.0 {
            return vec![free / 2.0];
        }
        let steps = (free / side).ceil();
        (0..=steps as usize)
            .map(|i| i as f64 * free / steps)
            .collect()
    };
    let (left, top) = (starts(width), starts(height));
    top.iter()
        .flat_map(|y| left.iter().map(|x| [*x, *y]))
        .collect()
}

/// The map `p -> scale p + shift`.
fn scale_and_shift(scale: f64, [x, y]: [f64; 2]) -> Matrix3<f64> {
    Matrix3::new(scale, 0.0, x, 0.0, scale, y, 0.0, 0.0, 1.0)
}

/// Centre of mass around a peak away from the edge.
fn centre_of_mass(values: &[f32], width: usize, [x, y]: [usize; 2]) -> [f64; 2] {
    let (mut mass, mut moment) = (0.0, [0.0, 0.0]);
    for yy in y - REFINE_PX..=y + REFINE_PX {
        for xx in x - REFINE_PX..=x + REFINE_PX {
            let value = f64::from(values[yy * width + xx]);
            mass += value;
            moment[0] += value * xx as f64;
            moment[1] += value * yy as f64;
        }
    }
    moment.map(|m| m / mass.max(f64::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::super::homography::HomographyRange;
    use super::super::photometric::Look;
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Detects the centre of the bright spot, and with a low probability a fixed pixel of the view.
    struct Blob;

    impl Detect for Blob {
        fn probabilities(&self, views: &[View]) -> Result<Vec<Vec<f32>>, TrainError> {
            let one = |view: &View| {
                let side = view.image.width();
                let (mut mass, mut moment) = (0.0f64, [0.0f64; 2]);
                for (x, y, pixel) in view.image.enumerate_pixels() {
                    let value = f64::from(pixel.0[1].saturating_sub(120));
                    mass += value;
                    moment[0] += value * f64::from(x);
                    moment[1] += value * f64::from(y);
                }
                let mut out = vec![0.0; (side * side) as usize];
                out[(side * 9 + 11) as usize] = 0.2;
                if mass > 0.0 {
                    let [x, y] = moment.map(|m| (m / mass).round() as usize);
                    out[y * side as usize + x] = 0.9;
                }
                out
            };
            Ok(views.iter().map(one).collect())
        }
    }

    fn options() -> LabelOptions {
        let look = Look {
            sat_strength: 0.1,
            uav_strength: 0.1,
            equalised: 0.0,
            shadows: 0.0,
            haze: 0.0,
            ..Look::default()
        };
        LabelOptions {
            views: 64,
            side_px: 96,
            homography: HomographyRange {
                shift: 0.05,
                ..LabelOptions::default().homography
            },
            look,
            threshold: 0.03,
            ..LabelOptions::default()
        }
    }

    /// A soft bright spot that every window of the picture contains as a whole or not at all.
    fn spot(at: [f64; 2]) -> Picture {
        Picture::new(RgbImage::from_fn(90, 84, |x, y| {
            let off = (f64::from(x) - at[0]).hypot(f64::from(y) - at[1]);
            image::Rgb([(40.0 + 190.0 * (-off * off / 18.0).exp()) as u8; 3])
        }))
    }

    #[test]
    fn one_blob_gives_one_label_within_a_fraction_of_a_pixel() {
        for at in [[44.0, 41.0], [40.3, 45.6], [47.8, 38.5]] {
            let labels = adapt(&spot(at), &options(), &Blob).unwrap();
            assert_eq!(labels.levels.len(), 1);
            let [[x, y, score]] = labels.levels[0][..] else {
                panic!("{:?}", labels.levels);
            };
            let off = (f64::from(x) - at[0]).hypot(f64::from(y) - at[1]);
            assert!(off < 0.3, "{x} {y} for {at:?}");
            assert!(score > 0.05, "{score}");
        }
    }

    /// Counts the cells that are not inside the picture, each of which must have a black pixel.
    struct Outside(AtomicUsize);

    impl Detect for Outside {
        fn probabilities(&self, views: &[View]) -> Result<Vec<Vec<f32>>, TrainError> {
            for view in views {
                let columns = view.image.width() / 8;
                let outside = (0u32..).zip(&view.seen).filter(|(_, seen)| !**seen);
                for (cell, _) in outside {
                    let (left, top) = (cell % columns * 8, cell / columns * 8);
                    let mut pixels =
                        (0..64).map(|i| view.image.get_pixel(left + i % 8, top + i / 8));
                    assert!(pixels.any(|pixel| pixel.0 == [0; 3]), "{left}, {top}");
                    self.0.fetch_add(1, Ordering::Relaxed);
                }
            }
            let nothing = |view: &View| vec![0.0; view.image.as_raw().len() / 3];
            Ok(views.iter().map(nothing).collect())
        }
    }

    #[test]
    fn views_are_black_outside_the_picture_under_every_look() {
        let options = LabelOptions {
            views: 16,
            look: Look {
                haze: 1.0,
                ..options().look
            },
            ..options()
        };
        let detector = Outside(AtomicUsize::new(0));
        adapt(&spot([44.0, 41.0]), &options, &detector).unwrap();
        assert!(detector.0.into_inner() > 100);
    }

    #[test]
    fn each_level_is_labelled_in_the_pictures_pixels_and_a_seed_decides() {
        let small = spot([44.0, 41.0]);
        let (image, _) = small.level(0);
        let large = image::imageops::resize(image, 180, 168, image::imageops::FilterType::Triangle);
        let picture = Picture::new(large);
        let options = LabelOptions {
            side_px: 192,
            ..options()
        };
        let labels = adapt(&picture, &options, &Blob).unwrap();
        assert_eq!(labels, adapt(&picture, &options, &Blob).unwrap());
        assert_eq!(labels.levels.len(), 2);
        for level in &labels.levels {
            assert_eq!(level.len(), 1, "{level:?}");
            let [x, y, _] = level[0];
            assert!((x - 88.5).hypot(y - 82.5) < 0.8, "{x} {y}");
        }
    }

    #[test]
    fn windows_cover_every_pixel() {
        assert_eq!(windows(90, 84, 96.0), [[-3.0, -6.0]]);
        let found = windows(1000, 416, 416.0);
        assert_eq!(found, [[0.0, 0.0], [292.0, 0.0], [584.0, 0.0]]);
    }
}
