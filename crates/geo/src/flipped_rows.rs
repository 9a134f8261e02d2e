//! Tiles whose rows are counted from the other side than their format counts them.

use crate::tile_index::TileIndex;
use crate::web_mercator::lonlat_from_web_mercator;

/// In words, that the stated bounds (west, south, east, north, degrees) share no latitude with the tiles of the finest zoom, and
/// would if rows were counted from the other side.
pub(crate) fn rows_look_flipped(index: &TileIndex, bounds_deg: [f64; 4]) -> Option<String> {
    let zoom = index.zooms().next_back()?;
    let range = index.range(zoom)?;
    let rows = (1_u64 << zoom) as f64;
    let lat_deg = |row: f64| lonlat_from_web_mercator([0.0, row / rows]).lat_deg;
    let north = lat_deg(f64::from(range.first_row));
    let south = lat_deg(f64::from(range.last_row) + 1.0);
    let (stated_south, stated_north) = (
        bounds_deg[1].min(bounds_deg[3]),
        bounds_deg[1].max(bounds_deg[3]),
    );
    let overlap = |south: f64, north: f64| stated_south <= north && stated_north >= south;
    // Rows from the other side are latitudes of the other sign.
    (!overlap(south, north) && overlap(-north, -south)).then(|| {
        format!(
            "rows counted from the other side: it states latitudes from {stated_south:.4} to {stated_north:.4}, and its tiles lie between \
             {south:.4} and {north:.4}"
        )
    })
}
