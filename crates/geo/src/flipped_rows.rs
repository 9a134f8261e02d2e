//! Tiles whose rows are counted from the other side than their format counts them.

use crate::tile_index::TileIndex;
use crate::web_mercator::lonlat_from_web_mercator;

/// In words, that the stated bounds (west, south, east, north, degrees) share no latitude with the tiles of the finest zoom, and
/// would if rows were counted from the other side.
pub(crate) fn rows_look_flipped(index: &TileIndex, bounds_deg: [f64; 4]) -> Option<String> {
    let (south, north) = latitudes_deg(index)?;
    let (stated_south, stated_north) = stated_latitudes_deg(bounds_deg);
    are_shared_only_flipped((south, north), (stated_south, stated_north)).then(|| {
        format!(
            "rows counted from the other side: it states latitudes from {stated_south:.4} to {stated_north:.4}, and its tiles lie between \
             {south:.4} and {north:.4}"
        )
    })
}

/// Whether the stated bounds fit the tiles of the finest zoom with rows counted from the other side, and not as they are counted;
/// `None` if they do not tell, as those of the whole world.
#[cfg(feature = "mbtiles")]
pub(crate) fn bounds_show_flipped_rows(index: &TileIndex, bounds_deg: [f64; 4]) -> Option<bool> {
    let (south, north) = latitudes_deg(index)?;
    let (stated_south, stated_north) = stated_latitudes_deg(bounds_deg);
    if are_shared_only_flipped((south, north), (stated_south, stated_north)) {
        return Some(true);
    }
    // A map across the equator shares latitudes with the bounds either way.
    let off_deg =
        |south: f64, north: f64| (stated_south - south).abs() + (stated_north - north).abs();
    let nearer_deg = off_deg(south, north) - off_deg(-north, -south);
    // Twice this if the bounds are those of the tiles.
    let least_deg = (south + north).abs();
    (nearer_deg.abs() > least_deg).then_some(nearer_deg > 0.0)
}

/// Whether two ranges of latitudes, south and north, overlap with the first one flipped and not as it is. Rows from the other side are
/// latitudes of the other sign.
fn are_shared_only_flipped((south, north): (f64, f64), stated: (f64, f64)) -> bool {
    let overlap = |south: f64, north: f64| stated.0 <= north && stated.1 >= south;
    !overlap(south, north) && overlap(-north, -south)
}

/// The southern and the northern edge of the tiles of the finest zoom.
fn latitudes_deg(index: &TileIndex) -> Option<(f64, f64)> {
    let zoom = index.zooms().next_back()?;
    let range = index.range(zoom)?;
    let rows = (1_u64 << zoom) as f64;
    let lat_deg = |row: f64| lonlat_from_web_mercator([0.0, row / rows]).lat_deg;
    Some((
        lat_deg(f64::from(range.last_row) + 1.0),
        lat_deg(f64::from(range.first_row)),
    ))
}

fn stated_latitudes_deg(bounds_deg: [f64; 4]) -> (f64, f64) {
    let [_, south, _, north] = bounds_deg;
    (south.min(north), south.max(north))
}
