//! Non-maximum suppression.

/// Local maxima of `values` (rows of `width`) above `floor` and at least `margin_px` from the edge, strongest first: no value
/// within `radius_px` along both axes is larger, and of equal values the first in row-major order is kept.
pub(super) fn peaks(
    values: &[f32],
    width: usize,
    radius_px: usize,
    margin_px: usize,
    floor: f32,
) -> Vec<(f32, [usize; 2])> {
    let height = values.len() / width.max(1);
    let mut found = Vec::new();
    for y in margin_px..height.saturating_sub(margin_px) {
        'next: for x in margin_px..width.saturating_sub(margin_px) {
            let value = values[y * width + x];
            if value <= floor {
                continue;
            }
            let (left, right) = (x.saturating_sub(radius_px), (x + radius_px).min(width - 1));
            for yy in y.saturating_sub(radius_px)..=(y + radius_px).min(height - 1) {
                for xx in left..=right {
                    let other = values[yy * width + xx];
                    if other > value || (other == value && (yy, xx) < (y, x)) {
                        continue 'next;
                    }
                }
            }
            found.push((value, [x, y]));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strongest_within_the_radius_stays_and_the_first_of_equals() {
        let mut values = vec![0.0; 20 * 10];
        for (x, y, v) in [
            (4, 5, 0.9),
            (7, 5, 0.8),
            (8, 5, 0.7),
            (14, 3, 0.5),
            (14, 4, 0.5),
            (0, 0, 1.0),
        ] {
            values[y * 20 + x] = v;
        }
        let found = peaks(&values, 20, 2, 1, 0.1);
        assert_eq!(found, [(0.9, [4, 5]), (0.8, [7, 5]), (0.5, [14, 3])]);
        assert_eq!(peaks(&values, 20, 3, 1, 0.6), [(0.9, [4, 5])]);
    }
}
