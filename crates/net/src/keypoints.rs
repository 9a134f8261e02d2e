//! Selection of keypoints from the heatmap.

use std::cmp::Ordering;

use image::GrayImage;
use rayon::prelude::*;

use crate::{ExtractOptions, Keypoint};

/// Smallest distance of keypoints from masked pixels: the edge of a mask is no feature of the place.
const MASK_MARGIN_PX: usize = 4;

/// Pixels of a row of the heatmap that are compared at a time.
const LANES: usize = 8;
/// Rows of the heatmap that are worth a task.
const ROWS_OF_TASK: usize = 64;

/// Local maxima of `heatmap` (rows of `width` probabilities) inside the window, strongest first; equal ones in raster order.
/// Neighbours outside the window are compared too, so that adjacent windows give the keypoints of the whole image. Maxima
/// near masked pixels are ignored; pixels outside the mask are masked.
pub(crate) fn keypoints(
    heatmap: &[f32],
    width: usize,
    [x0, y0, x1, y1]: [usize; 4],
    options: &ExtractOptions,
    mask: Option<&GrayImage>,
) -> Vec<Keypoint> {
    let height = heatmap.len() / width.max(1);
    let radius = options.nms_radius_px as usize;
    let peaks_of_row = |y: usize| {
        let mut found = Vec::new();
        let row = &heatmap[y * width..][..width];
        let mut consider = |x: usize| {
            if is_peak(heatmap, width, height, x, y, radius)
                && mask.is_none_or(|mask| is_seen_around(mask, x, y, width, height))
            {
                found.push(Keypoint {
                    x_px: x as f32,
                    y_px: y as f32,
                    score: row[x],
                });
            }
        };
        let window = &row[x0..x1];
        let (chunks, rest) = window.as_chunks::<LANES>();
        for (i, chunk) in chunks.iter().enumerate() {
            // Almost all pixels are below the threshold: one comparison for eight.
            if chunk
                .iter()
                .fold(false, |any, &v| any | (v > options.threshold))
            {
                let strong = chunk
                    .iter()
                    .enumerate()
                    .filter(|&(_, &v)| v > options.threshold);
                strong.for_each(|(lane, _)| consider(x0 + i * LANES + lane));
            }
        }
        let tail = x1 - rest.len();
        (tail..x1)
            .filter(|&x| row[x] > options.threshold)
            .for_each(&mut consider);
        found
    };
    let mut found: Vec<Keypoint> = (y0..y1)
        .into_par_iter()
        .with_min_len(ROWS_OF_TASK)
        .flat_map_iter(peaks_of_row)
        .collect();
    // Equal scores in raster order.
    let stronger = |a: &Keypoint, b: &Keypoint| {
        let place = |k: &Keypoint| (k.y_px, k.x_px);
        b.score
            .total_cmp(&a.score)
            .then(place(a).partial_cmp(&place(b)).unwrap_or(Ordering::Equal))
    };
    if options.max_keypoints == 0 {
        found.clear();
    } else if found.len() > options.max_keypoints {
        found.select_nth_unstable_by(options.max_keypoints - 1, stronger);
        found.truncate(options.max_keypoints);
    }
    found.sort_unstable_by(stronger);
    found
}

/// Whether no neighbour is larger, and no equal one comes earlier in raster order.
fn is_peak(
    heatmap: &[f32],
    width: usize,
    height: usize,
    x: usize,
    y: usize,
    radius: usize,
) -> bool {
    let at = y * width + x;
    let value = heatmap[at];
    // Most pixels beside a peak fail already against their four neighbours.
    let is_beside_a_peak = (x > 0 && heatmap[at - 1] >= value)
        || (x + 1 < width && heatmap[at + 1] > value)
        || (y > 0 && heatmap[at - width] >= value)
        || (y + 1 < height && heatmap[at + width] > value);
    if radius > 0 && is_beside_a_peak {
        return false;
    }
    let (left, right) = (x.saturating_sub(radius), (x + radius).min(width - 1));
    (y.saturating_sub(radius)..=(y + radius).min(height - 1)).all(|ny| {
        let row = &heatmap[ny * width..][..width];
        let split = match ny.cmp(&y) {
            Ordering::Less => right + 1,
            Ordering::Equal => x,
            Ordering::Greater => left,
        };
        row[left..split].iter().all(|&v| v < value)
            && row[split..=right].iter().all(|&v| v <= value)
    })
}

/// Whether no pixel of the image within the margin is masked.
fn is_seen_around(mask: &GrayImage, x: usize, y: usize, width: usize, height: usize) -> bool {
    let (left, right) = (
        x.saturating_sub(MASK_MARGIN_PX),
        (x + MASK_MARGIN_PX).min(width - 1),
    );
    let (top, bottom) = (
        y.saturating_sub(MASK_MARGIN_PX),
        (y + MASK_MARGIN_PX).min(height - 1),
    );
    let (mask_width, mask_height) = (mask.width() as usize, mask.height() as usize);
    if right >= mask_width || bottom >= mask_height {
        return false;
    }
    (top..=bottom).all(|y| {
        mask.as_raw()[y * mask_width + left..=y * mask_width + right]
            .iter()
            .all(|&v| v != 0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;
    use proptest::prelude::*;

    const WIDTH: usize = 24;
    const HEIGHT: usize = 16;
    const ALL: [usize; 4] = [0, 0, WIDTH, HEIGHT];

    fn options(threshold: f32, max_keypoints: usize, nms_radius_px: u32) -> ExtractOptions {
        ExtractOptions {
            threshold,
            max_keypoints,
            nms_radius_px,
        }
    }

    fn places(found: &[Keypoint]) -> Vec<(f32, f32)> {
        found.iter().map(|k| (k.x_px, k.y_px)).collect()
    }

    #[test]
    fn equal_neighbours_give_one_keypoint_the_first() {
        let mut heatmap = vec![0.0; WIDTH * HEIGHT];
        for (x, y) in [(5, 5), (6, 5), (5, 6), (20, 3)] {
            heatmap[y * WIDTH + x] = 0.5;
        }
        assert_eq!(
            places(&keypoints(&heatmap, WIDTH, ALL, &options(0.1, 9, 2), None)),
            [(20.0, 3.0), (5.0, 5.0)]
        );
        assert_eq!(
            places(&keypoints(&heatmap, WIDTH, ALL, &options(0.1, 1, 2), None)),
            [(20.0, 3.0)]
        );
        assert!(keypoints(&heatmap, WIDTH, ALL, &options(0.1, 0, 2), None).is_empty());
        assert!(
            keypoints(&heatmap, WIDTH, ALL, &options(0.5, 9, 2), None).is_empty(),
            "the threshold itself is not enough"
        );
    }

    #[test]
    fn unseen_pixels_keep_their_distance_but_the_border_does_not() {
        let mut heatmap = vec![0.0; WIDTH * HEIGHT];
        for (x, y) in [(0, 0), (7, 8), (8, 8), (16, 8), (17, 8), (23, 15)] {
            heatmap[y * WIDTH + x] = 0.5;
        }
        let mask = GrayImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
            Luma([if (x, y) == (12, 12) { 0 } else { 255 }])
        });
        let found = keypoints(&heatmap, WIDTH, ALL, &options(0.1, 9, 0), Some(&mask));
        assert_eq!(
            places(&found),
            [(0.0, 0.0), (7.0, 8.0), (17.0, 8.0), (23.0, 15.0)]
        );
        let small = GrayImage::from_pixel(12, 12, Luma([255]));
        assert_eq!(
            places(&keypoints(
                &heatmap,
                WIDTH,
                ALL,
                &options(0.1, 9, 0),
                Some(&small)
            )),
            [(0.0, 0.0)]
        );
    }

    fn naive(
        heatmap: &[f32],
        [x0, y0, x1, y1]: [usize; 4],
        options: &ExtractOptions,
    ) -> Vec<Keypoint> {
        let radius = options.nms_radius_px as i64;
        let mut found = Vec::new();
        for y in y0..y1 {
            for x in x0..x1 {
                let value = heatmap[y * WIDTH + x];
                let mut peak = value > options.threshold;
                for (i, &other) in heatmap.iter().enumerate() {
                    let near = ((i / WIDTH) as i64 - y as i64).abs() <= radius
                        && ((i % WIDTH) as i64 - x as i64).abs() <= radius;
                    peak &= !(near && (other > value || other == value && i < y * WIDTH + x));
                }
                if peak {
                    found.push(Keypoint {
                        x_px: x as f32,
                        y_px: y as f32,
                        score: value,
                    });
                }
            }
        }
        found.sort_by(|a, b| b.score.partial_cmp(&a.score).unwrap());
        found.truncate(options.max_keypoints);
        found
    }

    proptest! {
        #[test]
        fn equals_the_plain_definition(
            levels in proptest::collection::vec(0u8..12, WIDTH * HEIGHT),
            radius in 0u32..5,
            max in 0usize..40,
            (x0, x1, y0, y1) in (0..10usize, 10..=WIDTH, 0..8usize, 8..=HEIGHT),
        ) {
            let heatmap: Vec<f32> = levels.iter().map(|&v| f32::from(v) / 12.0).collect();
            let options = options(0.3, max, radius);
            let window = [x0, y0, x1, y1];
            prop_assert_eq!(keypoints(&heatmap, WIDTH, window, &options, None), naive(&heatmap, window, &options));
        }
    }
}
