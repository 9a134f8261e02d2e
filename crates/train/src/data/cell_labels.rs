//! Keypoint labels: one class for each 8 x 8 cell of a view, one of its 64 pixels or "no keypoint" (DeTone et al. 2018).

use super::corners::corners;
use super::counterpart::Counterpart;
use super::mapping::Mapping;
use image::RgbImage;

/// The label of a cell without a keypoint; the others are `8 * row + column` inside the cell.
pub const LABEL_NONE: u8 = 64;
/// Corners nearer to each other than this, after mapping, are the same.
const SAME_CORNER_PX: f64 = 2.0;
/// Most corners of a view.
const MOST_CORNERS: usize = 600;

/// The labels of a square view.
pub(super) struct CellLabels {
    side: usize,
    labels: Vec<u8>,
}

impl CellLabels {
    /// No keypoints; `side` in pixels.
    pub(super) fn new(side: usize) -> Self {
        Self {
            side,
            labels: vec![LABEL_NONE; (side / 8).pow(2)],
        }
    }

    /// Labels from points, the strongest first, rounded to pixels. Points outside the view, or in cells that are not `seen`,
    /// are ignored.
    pub(super) fn of_points(points: &[[f64; 2]], side: usize, seen: Option<&[bool]>) -> Self {
        let mut out = Self::new(side);
        for point in points {
            let [x, y] = point.map(f64::round);
            let inside = 0.0..side as f64;
            if !(inside.contains(&x) && inside.contains(&y)) {
                continue;
            }
            let (x, y) = (x as usize, y as usize);
            if seen.is_none_or(|seen| seen[out.cell(x, y)]) {
                out.set(x, y);
            }
        }
        out
    }

    fn cell(&self, x: usize, y: usize) -> usize {
        (y / 8) * (self.side / 8) + x / 8
    }

    /// Labels a pixel, unless its cell has a label.
    fn set(&mut self, x: usize, y: usize) {
        let cell = self.cell(x, y);
        let label = &mut self.labels[cell];
        if *label == LABEL_NONE {
            *label = ((y % 8) * 8 + x % 8) as u8;
        }
    }

    /// The labels of the cells, row by row.
    pub(super) fn into_labels(self) -> Vec<u8> {
        self.labels
    }
}

/// A mask of the pixels within [`SAME_CORNER_PX`] of a corner.
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

/// Labels from corners that are found in the map view before and after photometric changes, and, if the photo contains the
/// point, in the photo. Where only one view contains a point, the corner of that view counts.
pub(super) fn surviving_corners(
    [sat_plain, uav_plain]: [&RgbImage; 2],
    [sat, uav]: [&RgbImage; 2],
    uav_seen: &[bool],
    mapping: &Mapping,
) -> [CellLabels; 2] {
    let side = sat.width() as usize;
    let [mut sat_labels, mut uav_labels] = [CellLabels::new(side), CellLabels::new(side)];
    let in_sat = near_corners(&corners(sat, 2, MOST_CORNERS), side);
    let uav_corners = corners(uav, 2, MOST_CORNERS);
    let in_uav = near_corners(&uav_corners, side);
    for [x, y] in corners(sat_plain, 3, MOST_CORNERS) {
        if !in_sat[y * side + x] {
            continue;
        }
        match mapping.uav_from_sat([x as f64, y as f64], side as f64, 1.0) {
            Counterpart::At([u, v]) => {
                let (u, v) = (u.round() as usize, v.round() as usize);
                if !uav_seen[uav_labels.cell(u, v)] {
                    sat_labels.set(x, y);
                } else if in_uav[v * side + u] {
                    sat_labels.set(x, y);
                    uav_labels.set(u, v);
                }
            }
            Counterpart::Outside => sat_labels.set(x, y),
            Counterpart::Hidden => {}
        }
    }
    let in_plain = near_corners(&corners(uav_plain, 2, MOST_CORNERS), side);
    for [x, y] in uav_corners {
        let unseen_by_sat =
            mapping.sat_from_uav([x as f64, y as f64], side as f64, 1.0) == Counterpart::Outside;
        if unseen_by_sat && in_plain[y * side + x] && uav_seen[uav_labels.cell(x, y)] {
            uav_labels.set(x, y);
        }
    }
    [sat_labels, uav_labels]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strongest_point_of_a_cell_is_its_label() {
        let points = [
            [9.6, 2.4],
            [12.0, 3.0],
            [-0.6, 0.0],
            [31.4, 31.4],
            [31.6, 5.0],
        ];
        let labels = CellLabels::of_points(&points, 32, None).into_labels();
        let set: Vec<(usize, u8)> = labels
            .iter()
            .copied()
            .enumerate()
            .filter(|(_, label)| *label != LABEL_NONE)
            .collect();
        assert_eq!(set, [(1, 2 * 8 + 2), (15, 63)]);
        let seen = vec![false; 16];
        let labels = CellLabels::of_points(&points, 32, Some(&seen)).into_labels();
        assert!(labels.iter().all(|label| *label == LABEL_NONE));
    }
}
