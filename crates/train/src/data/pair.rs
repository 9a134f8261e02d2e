//! A training pair: two views of one place with labels and corresponding points.

use super::cell_labels::{CellLabels, surviving_corners};
use super::counterpart::Counterpart;
use super::homography::HomographyRange;
use super::mapping::Mapping;
use super::photometric::{Look, change_look, rebuild_ground};
use super::scene::Scene;
use grimnet_net::Domain;
use image::RgbImage;
use nalgebra::Matrix3;
use rand::Rng as _;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// How pairs are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PairOptions {
    /// Side of both views, pixels; a multiple of 32.
    pub side_px: u32,
    /// Number of windows taken from one picture, at most two of a small one; they are hard negatives of each other where they do not
    /// overlap, which most windows of a small picture do.
    pub group: usize,
    /// Corresponding points that the descriptor loss compares.
    pub points: usize,
    /// Share of pairs whose photo has black corners, like a photo that was rotated north-up.
    pub black_corners: f64,
    /// Range of the homographies between the views.
    pub homography: HomographyRange,
    /// Range of the photometric changes.
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

/// Where the map view of a pair is. Overlapping places are not negatives of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// The picture, world or data set that the window lies in, numbered through all data.
    pub picture: usize,
    /// Left, top, right, bottom; the unit (pixels or metres) is the same for all windows of a picture.
    pub window: [f64; 4],
}

impl Place {
    /// Intersection of the windows as a share of the smaller one, 0 to 1.
    pub fn overlap(&self, other: &Place) -> f64 {
        if self.picture != other.picture {
            return 0.0;
        }
        let (a, b) = (self.window, other.window);
        let w = (a[2].min(b[2]) - a[0].max(b[0])).max(0.0);
        let h = (a[3].min(b[3]) - a[1].max(b[1])).max(0.0);
        let area = |r: [f64; 4]| (r[2] - r[0]) * (r[3] - r[1]);
        w * h / area(a).min(area(b)).max(1e-9)
    }
}

/// Two views of one place with ground truth.
#[derive(Clone, Debug)]
pub struct Pair {
    /// The map view.
    pub sat: RgbImage,
    /// The drone view.
    pub uav: RgbImage,
    /// For each 8 x 8 cell of the drone view, whether all of it is inside the picture.
    pub uav_seen: Vec<bool>,
    /// Keypoint label of each cell of the map view.
    pub sat_labels: Vec<u8>,
    /// Keypoint label of each cell of the drone view.
    pub uav_labels: Vec<u8>,
    /// Points of the map view, pixels (x, y); empty if corresponding points are not known.
    pub sat_points: Vec<[f32; 2]>,
    /// The same points in the drone view.
    pub uav_points: Vec<[f32; 2]>,
    /// Homography from pixels of the map view to pixels of the drone view, for points on the ground.
    pub uav_from_sat_px: Matrix3<f64>,
    /// The relation of the views for all points.
    pub mapping: Mapping,
    /// Where the map view is.
    pub place: Place,
    /// Scene class, if the data set gives one.
    pub scene: Option<Scene>,
}

/// A source of training pairs.
pub trait Source: Send + Sync {
    /// At most `count` pairs that are hard negatives of each other.
    fn group(&self, count: usize, options: &PairOptions, random: &mut ChaCha8Rng) -> Vec<Pair>;

    /// Number of scene classes of its pairs.
    fn scenes(&self) -> usize {
        0
    }
}

/// Origin of the keypoint labels of a pair.
pub(super) enum Keypoints {
    /// Corners that are found under the looks of both views.
    Corners,
    /// Known points of the map view and of the drone view, the strongest first; points outside a view are ignored.
    Known([Vec<[f64; 2]>; 2]),
}

/// Two views of a place before photometric changes.
pub(super) struct Views {
    /// The map view and the drone view.
    pub(super) plain: [RgbImage; 2],
    /// For each pixel of the drone view, whether it is inside the picture.
    pub(super) seen: Vec<bool>,
    /// As [`Pair::uav_from_sat_px`].
    pub(super) uav_from_sat: Matrix3<f64>,
    pub(super) mapping: Mapping,
    pub(super) place: Place,
    pub(super) scene: Option<Scene>,
    pub(super) keypoints: Keypoints,
    /// A view of another picture, for [`Look::mixed`].
    pub(super) other: Option<RgbImage>,
}

/// For each 8 x 8 cell of a square view, whether all its pixels are marked.
pub(super) fn seen_cells(seen: &[bool], side: usize) -> Vec<bool> {
    let cells = side / 8;
    (0..cells * cells)
        .map(|cell| {
            let (cy, cx) = (cell / cells, cell % cells);
            (0..8).all(|y| (0..8).all(|x| seen[(cy * 8 + y) * side + cx * 8 + x]))
        })
        .collect()
}

/// Makes the pixels of a view that are not marked black.
pub(super) fn black_outside(view: &mut RgbImage, seen: &[bool]) {
    for (pixel, seen) in view.pixels_mut().zip(seen) {
        if !seen {
            pixel.0 = [0; 3];
        }
    }
}

impl Views {
    fn side(&self) -> usize {
        self.plain[0].width() as usize
    }

    /// Corresponding points: one random point in each of `wanted` random cells of the map view; `None` if fewer cells have
    /// a point that both views see. `unchanged` are the cells of the drone view that lie in the picture and show the ground of the map.
    fn points(
        &self,
        wanted: usize,
        unchanged: &[bool],
        random: &mut ChaCha8Rng,
    ) -> Option<[Vec<[f32; 2]>; 2]> {
        let side = self.side();
        let cells = side / 8;
        let sees = |[x, y]: [f64; 2]| unchanged[(y as usize / 8) * cells + x as usize / 8];
        let mut order: Vec<usize> = (0..cells * cells).collect();
        order.shuffle(random);
        let [mut sat_points, mut uav_points] = [Vec::new(), Vec::new()];
        for cell in order {
            let at = [
                (cell % cells * 8) as f64 + random.random_range(-0.5..7.5),
                (cell / cells * 8) as f64 + random.random_range(-0.5..7.5),
            ];
            if let Counterpart::At(there) = self.mapping.uav_from_sat(at, side as f64, 3.0)
                && sees(there)
            {
                sat_points.push(at.map(|v| v as f32));
                uav_points.push(there.map(|v| v as f32));
                if sat_points.len() == wanted {
                    return Some([sat_points, uav_points]);
                }
            }
        }
        None
    }

    /// Applies photometric changes and adds labels and points; `None` if the views share too few points.
    pub(super) fn finish(mut self, options: &PairOptions, random: &mut ChaCha8Rng) -> Option<Pair> {
        let uav_seen = seen_cells(&self.seen, self.side());
        let mut unchanged = uav_seen.clone();
        if let Some((photo, rebuilt)) = rebuild_ground(&self.plain[1], &options.look, random) {
            self.plain[1] = photo;
            let stays: Vec<bool> = self
                .seen
                .iter()
                .zip(rebuilt)
                .map(|(seen, rebuilt)| *seen && !rebuilt)
                .collect();
            unchanged = seen_cells(&stays, self.side());
        }
        // Not a second time.
        let look = Look {
            rebuilt: 0.0,
            ..options.look
        };
        let [sat_points, uav_points] = self.points(options.points, &unchanged, random)?;
        let [sat_plain, uav_plain] = &self.plain;
        let [sat, mut uav] = [(sat_plain, Domain::Sat), (uav_plain, Domain::Uav)]
            .map(|(plain, domain)| change_look(plain, self.other.as_ref(), domain, &look, random));
        let side = self.side();
        let [sat_labels, uav_labels] = match &self.keypoints {
            Keypoints::Corners => surviving_corners(
                [sat_plain, uav_plain],
                [&sat, &uav],
                &uav_seen,
                &self.mapping,
            ),
            Keypoints::Known([in_sat, in_uav]) => [
                CellLabels::of_points(in_sat, side, None),
                CellLabels::of_points(in_uav, side, Some(&unchanged)),
            ],
        }
        .map(CellLabels::into_labels);
        black_outside(&mut uav, &self.seen);
        Some(Pair {
            sat,
            uav,
            uav_seen,
            sat_labels,
            uav_labels,
            sat_points,
            uav_points,
            uav_from_sat_px: self.uav_from_sat,
            mapping: self.mapping,
            place: self.place,
            scene: self.scene,
        })
    }
}
