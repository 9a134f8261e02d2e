//! `GET /v1/tracks/{id}/session`: a track with its map as one HTML file, which opens without any server.

use std::sync::Arc;

use axum::extract::Path;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use grimnet_geo::LonLat;
use serde::Serialize;

use crate::maps::ServedMap;
use crate::problem::Problem;
use crate::state::{Shared, State};
use crate::tile_address::TileAddress;
use crate::tile_cache::Layer;
use crate::tile_routes::tile_of;
use crate::track_store::TrackFrame;

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
    track: u64,
    map: &'a str,
    outline_lon_lat_deg: Vec<[f64; 2]>,
    tiles: Vec<SessionTile>,
    frames: Vec<TrackFrame>,
}

/// A square picture in Web Mercator, the world from 0 to 1, y to the south.
#[derive(Serialize)]
struct SessionTile {
    west: f64,
    north: f64,
    side: f64,
    /// As a `data:` address.
    picture: String,
}

/// A track as one file
///
/// HTML with the map, the track and a slider for its frames. It opens from a disk, and asks for nothing from anywhere.
#[utoipa::path(
    get, path = "/v1/tracks/{id}/session", tag = "tracks", params(("id" = u64, Path, description = "The track")),
    responses((status = 200, description = "The file", body = String, content_type = "text/html"))
)]
pub(crate) async fn session(
    axum::extract::State(state): Shared,
    Path(id): Path<String>,
) -> Result<Response, Problem> {
    let track = state.tracks.get(&id)?;
    let map = state.maps.get(&track.map)?;
    let text = page(&Session {
        track: track.id,
        map: map.id(),
        outline_lon_lat_deg: map
            .outline
            .iter()
            .map(|point| [point.lon_deg, point.lat_deg])
            .collect(),
        tiles: tiles(&state, map).await?,
        frames: track.frames(),
    })?;
    let disposition = format!("attachment; filename=\"track-{}.html\"", track.id);
    let disposition =
        HeaderValue::from_str(&disposition).unwrap_or(HeaderValue::from_static("attachment"));
    Ok((
        [
            (
                header::CONTENT_TYPE,
                HeaderValue::from_static("text/html; charset=utf-8"),
            ),
            (header::CONTENT_DISPOSITION, disposition),
        ],
        text,
    )
        .into_response())
}

/// The map in tiles of the finest zoom at which they are not too many.
async fn tiles(state: &Arc<State>, map: &ServedMap) -> Result<Vec<SessionTile>, Problem> {
    let layer = match map.raster {
        Some(_) => Layer::Map,
        None => Layer::Outlines,
    };
    let mut tiles = Vec::new();
    for address in covering(map.bounds_deg(), map.zooms()) {
        let tile = tile_of(state, map.id(), layer, address).await?;
        let [west, north] = address.world(0.0, 0.0);
        let [east, _] = address.world(1.0, 1.0);
        tiles.push(SessionTile {
            west,
            north,
            side: east - west,
            picture: format!(
                "data:{};base64,{}",
                tile.media_type,
                STANDARD.encode(&tile.bytes)
            ),
        });
    }
    Ok(tiles)
}

/// The tiles over west, south, east and north (degrees), at the finest zoom between two at which they are not too many.
fn covering(
    [west, south, east, north]: [f64; 4],
    [coarsest, finest]: [u32; 2],
) -> Vec<TileAddress> {
    let mut covering = Vec::new();
    for zoom in coarsest..=finest {
        let corners = [LonLat::new(west, north), LonLat::new(east, south)];
        let [Some(from), Some(to)] = corners.map(|corner| TileAddress::at(zoom, corner)) else {
            break;
        };
        let found = from.rectangle(to);
        if !covering.is_empty() && found.len() > MAX_TILES as usize {
            break;
        }
        covering = found;
    }
    covering.truncate(MAX_TILES as usize);
    covering
}

fn page(session: &Session<'_>) -> Result<String, Problem> {
    let json = serde_json::to_string(session).map_err(|error| {
        tracing::error!(%error, "a session cannot be written");
        Problem::internal()
    })?;
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
        let Some((before, after)) = rest.split_once(place) else {
            tracing::error!("the page of sessions has no {place}");
            return Err(Problem::internal());
        };
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
    fn names_cannot_end_the_script() {
        let session = Session {
            track: 1,
            map: "</script><script>alert(1)</script>/*SCRIPT*/",
            outline_lon_lat_deg: Vec::new(),
            tiles: Vec::new(),
            frames: Vec::new(),
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
