//! Numbers of tiles along the Hilbert curve of PMTiles.

use crate::tile_address::{MAX_ZOOM, TileAddress};

/// Number of the first tile of a zoom: there are `4^z` tiles at zoom `z`.
pub(crate) fn first_of_zoom(zoom: u8) -> u64 {
    ((1_u64 << (2 * zoom)) - 1) / 3
}

/// The tile of a number (PMTiles v3, section 4.1); `None` beyond the finest zoom that is read.
pub(crate) fn tile_of_number(number: u64) -> Option<TileAddress> {
    let zoom = (0..=MAX_ZOOM)
        .rev()
        .find(|&zoom| first_of_zoom(zoom) <= number)?;
    let mut along = number - first_of_zoom(zoom);
    let side = 1_u64 << zoom;
    if along >= side * side {
        return None;
    }
    let (mut x, mut y) = (0_u64, 0_u64);
    let mut step = 1;
    while step < side {
        let right = 1 & (along / 2);
        let up = 1 & (along ^ right);
        if up == 0 {
            if right == 1 {
                x = step - 1 - x;
                y = step - 1 - y;
            }
            std::mem::swap(&mut x, &mut y);
        }
        x += step * right;
        y += step * up;
        along /= 4;
        step *= 2;
    }
    TileAddress::new(u64::from(zoom), x, y)
}

/// The number of a tile.
pub(crate) fn number_of_tile(tile: TileAddress) -> u64 {
    let (mut x, mut y) = (u64::from(tile.column), u64::from(tile.row));
    let mut along = 0;
    let mut step = (1_u64 << tile.zoom) / 2;
    while step > 0 {
        let right = u64::from(x & step > 0);
        let up = u64::from(y & step > 0);
        along += step * step * ((3 * right) ^ up);
        x &= step.max(1) - 1;
        y &= step.max(1) - 1;
        if up == 0 {
            if right == 1 {
                x = step - 1 - x;
                y = step - 1 - y;
            }
            std::mem::swap(&mut x, &mut y);
        }
        step /= 2;
    }
    first_of_zoom(tile.zoom) + along
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Values of the reference implementation, `pmtiles.tile.zxy_to_tileid` of PyPI's pmtiles 3.8.1.
    const REFERENCE: [(u8, u32, u32, u64); 9] = [
        (0, 0, 0, 0),
        (1, 0, 0, 1),
        (1, 0, 1, 2),
        (1, 1, 1, 3),
        (1, 1, 0, 4),
        (2, 1, 3, 11),
        (2, 3, 0, 20),
        (3, 5, 6, 60),
        (12, 3423, 1763, 19_078_479),
    ];

    #[test]
    fn numbers_are_those_of_the_reference() {
        for (zoom, column, row, number) in REFERENCE {
            let tile = TileAddress { zoom, column, row };
            assert_eq!(number_of_tile(tile), number, "{tile}");
            assert_eq!(tile_of_number(number), Some(tile), "{number}");
        }
        assert_eq!(tile_of_number(first_of_zoom(MAX_ZOOM + 1)), None);
        assert_eq!(tile_of_number(u64::MAX), None);
    }

    proptest! {
        #[test]
        fn a_tile_has_one_number(zoom in 0..=MAX_ZOOM, column in any::<u32>(), row in any::<u32>()) {
            let mask = ((1_u64 << zoom) - 1) as u32;
            let tile = TileAddress { zoom, column: column & mask, row: row & mask };
            prop_assert_eq!(tile_of_number(number_of_tile(tile)), Some(tile));
        }
    }
}
