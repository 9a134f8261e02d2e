//! The paper's tile grid (eq. 1).

/// Columns and rows of tiles of side `tile_px` at stride `stride_px` on a level of `size_px`: i in {0, ..., (H - Sp) /
/// stride}, where they fit. What remains at the right and lower edge is not covered, and a map smaller than a tile has
/// no tiles (`[0, 0]`).
pub(crate) fn tile_grid(size_px: [u64; 2], tile_px: u64, stride_px: u64) -> [u64; 2] {
    let count = |side_px: u64| match side_px.checked_sub(tile_px) {
        None => 0,
        Some(rest) => rest / stride_px + 1,
    };
    match size_px.map(count) {
        [0, _] | [_, 0] => [0, 0],
        grid => grid,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn tiles_fit_and_no_further_one_would(width in 512u64..3000, height in 512u64..3000) {
            let grid = tile_grid([width, height], 512, 256);
            for (count, side) in grid.into_iter().zip([width, height]) {
                let end = (count - 1) * 256 + 512;
                prop_assert!(end <= side && side < end + 256);
            }
        }
    }

    #[test]
    fn counted_by_hand() {
        assert_eq!(tile_grid([4103, 3894], 512, 256), [15, 14]);
        assert_eq!(tile_grid([512, 512], 512, 256), [1, 1]);
        assert_eq!(tile_grid([511, 4000], 512, 256), [0, 0]);
    }
}
