//! A track with its map as one HTML file, which opens without any server.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use grimnet_geo::LonLat;
use serde::Serialize;

use crate::error::ServeError;
use crate::maps::ServedMap;
use crate::tile_address::TileAddress;
use crate::tile_cache::{Layer, Tile};
use crate::tile_rendering::rendered_tile;
use crate::track_frame::TrackFrame;

/// Most tiles of 256 px that a file holds: pictures of about a megabyte.
const MAX_TILES: u32 = 25;

/// The page, with places for its style, its script and the session.
const PAGE: &str = include_str!("../web/session.html");
const STYLE: &str = include_str!("../web/style.css");
const SHAPES: &str = include_str!("../web/track_shapes.js");
const SCRIPT: &str = include_str!("../web/session.js");

/// What the page shows.
#[derive(Serialize)]
struct Session<'a> {
    title: &'a str,
    outline_lon_lat_deg: Vec<[f64; 2]>,
    tiles: Vec<SessionTile>,
    frames: &'a [&'a TrackFrame],
}

/// A square picture in Web Mercator, the world from 0 to 1, y to the south. East of the antimeridian x is above 1.
#[derive(Serialize)]
struct SessionTile {
    west: f64,
    north: f64,
    side: f64,
    /// As a `data:` address.
    picture: String,
}

impl SessionTile {
    /// The picture of a tile of a map whose western edge is at `map_west_deg`.
    fn new(address: TileAddress, tile: &Tile, map_west_deg: f64) -> Self {
        let [west, north] = address.world(0.0, 0.0);
        let [east, _] = address.world(1.0, 1.0);
        let side = east - west;
        // Tiles that end west of the map are those beyond the antimeridian.
        let is_beyond = east * 360.0 - 180.0 <= map_west_deg;
        let west = if is_beyond { west + 1.0 } else { west };
        let bytes = STANDARD.encode(&tile.bytes);
        Self {
            west,
            north,
            side,
            picture: format!("data:{};base64,{bytes}", tile.media_type),
        }
    }
}

/// A track with its map as one HTML file of a few megabytes: the map, the track and a slider for its frames. It opens from a disk, and
/// asks for nothing from anywhere. The background are the outlines of the pack where the map has no picture.
///
/// # Errors
/// Returns [`ServeError::Map`] if the map cannot be read.
pub fn session_page(
    title: &str,
    map: &ServedMap,
    frames: &[TrackFrame],
) -> Result<String, ServeError> {
    let layer = session_layer(map);
    let mut tiles = Vec::new();
    for address in session_tiles(map) {
        tiles.push((address, rendered_tile(map, layer, address)?));
    }
    let frames: Vec<&TrackFrame> = frames.iter().collect();
    page_of_tiles(title, map, &tiles, &frames)
}

/// What the tiles of a session show.
pub(crate) fn session_layer(map: &ServedMap) -> Layer {
    match map.raster {
        Some(_) => Layer::Map,
        None => Layer::Outlines,
    }
}

/// The map in tiles of the finest zoom at which they are not too many.
pub(crate) fn session_tiles(map: &ServedMap) -> Vec<TileAddress> {
    covering(map.bounds_deg(), map.zooms())
}

/// As [`session_page`], with the tiles at [`session_tiles`].
pub(crate) fn page_of_tiles(
    title: &str,
    map: &ServedMap,
    tiles: &[(TileAddress, Tile)],
    frames: &[&TrackFrame],
) -> Result<String, ServeError> {
    let outline = map.outline.iter();
    let [map_west_deg, ..] = map.bounds_deg();
    page(&Session {
        title,
        outline_lon_lat_deg: outline
            .map(|point| [point.lon_deg, point.lat_deg])
            .collect(),
        tiles: tiles
            .iter()
            .map(|(address, tile)| SessionTile::new(*address, tile, map_west_deg))
            .collect(),
        frames,
    })
}

/// The tiles over west, south, east and north (degrees), at the finest zoom between two at which they are not too many. East is above
/// 180 where the antimeridian is crossed.
fn covering(
    [west, south, east, north]: [f64; 4],
    [coarsest, finest]: [u32; 2],
) -> Vec<TileAddress> {
    let parts = if east > 180.0 {
        vec![[west, 180.0], [-180.0, east - 360.0]]
    } else {
        vec![[west, east]]
    };
    let mut covering = Vec::new();
    for zoom in coarsest..=finest {
        let mut found = Vec::new();
        for [west, east] in &parts {
            let corners = [LonLat::new(*west, north), LonLat::new(*east, south)];
            let [Some(from), Some(to)] = corners.map(|corner| TileAddress::at(zoom, corner)) else {
                return covering;
            };
            found.extend(from.rectangle(to));
        }
        if !covering.is_empty() && found.len() > MAX_TILES as usize {
            break;
        }
        covering = found;
    }
    covering.truncate(MAX_TILES as usize);
    covering
}

fn page(session: &Session<'_>) -> Result<String, ServeError> {
    let json = serde_json::to_string(session)?;
    // Names of photos are the client's: nothing in them may end the script.
    let json = json.replace('<', "\\u003c");
    let script = format!("{SHAPES}\n{SCRIPT}");
    let mut page = String::with_capacity(PAGE.len() + STYLE.len() + script.len() + json.len());
    let mut rest = PAGE;
    for (place, content) in [
        ("/*STYLE*/", STYLE),
        ("/*SESSION*/", json.as_str()),
        ("/*SCRIPT*/", script.as_str()),
    ] {
        // A test looks for what each place holds.
        let (before, after) = rest.split_once(place).unwrap_or((rest, ""));
        page.push_str(before);
        page.push_str(content);
        rest = after;
    }
    page.push_str(rest);
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_finest_zoom_that_is_not_too_much() {
        let bounds = [1.5, 1.0, 1.511, 1.011];
        let found = covering(bounds, [12, 19]);
        assert!((6..=MAX_TILES as usize).contains(&found.len()), "{found:?}");
        let middle = TileAddress::at(found[0].zoom(), LonLat::new(1.5055, 1.0055)).unwrap();
        assert!(found.contains(&middle));
        assert!(covering(bounds, [12, 12]).len() <= 4);
    }

    #[test]
    fn a_map_over_the_antimeridian_is_covered_on_both_sides() {
        let west = 179.9985;
        let found = covering([west, -17.003, 180.0015, -17.0], [12, 18]);
        let picture = Tile {
            bytes: Vec::new().into(),
            media_type: "image/png",
            tag: axum::http::HeaderValue::from_static("\"\""),
        };
        let tiles = found
            .iter()
            .map(|address| SessionTile::new(*address, &picture, west));
        // Side by side, from the west of the map to its east.
        let mut columns: Vec<f64> = tiles.clone().map(|tile| tile.west).collect();
        columns.sort_by(f64::total_cmp);
        columns.dedup();
        let side = tiles.clone().next().unwrap().side;
        assert!(columns.windows(2).all(|pair| pair[1] - pair[0] == side));
        let degrees = |world: f64| world * 360.0 - 180.0;
        assert!(degrees(columns[0]) <= west, "{columns:?}");
        let end = degrees(columns[columns.len() - 1] + side);
        assert!((180.0015..180.01).contains(&end), "{columns:?}");
    }

    #[test]
    fn names_cannot_end_the_script() {
        let session = Session {
            title: "</script><script>alert(1)</script>/*SCRIPT*/",
            outline_lon_lat_deg: Vec::new(),
            tiles: Vec::new(),
            frames: &[],
        };
        let page = page(&session).ok().unwrap();
        assert_eq!(page.matches("<script").count(), 2, "its own two");
        assert_eq!(page.matches("</script>").count(), 2);
        assert!(
            page.contains("/*SCRIPT*/\""),
            "what a client sends is not a place"
        );
        assert!(page.contains("function ellipse"));
    }
}
