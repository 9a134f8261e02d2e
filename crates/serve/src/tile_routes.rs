//! `GET /v1/maps/{id}/tiles/{z}/{x}/{y}` and the TileJSON that describes them.

use std::sync::Arc;

use axum::Json;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

use crate::background::in_background;
use crate::entity_tag::is_known;
use crate::forwarded::scheme_of;
use crate::path::Path;
use crate::problem::Problem;
use crate::protection::host_of;
use crate::query::Query;
use crate::state::{Shared, State};
use crate::tile_address::{MAX_ZOOM, TileAddress};
use crate::tile_cache::{Layer, Tile};
use crate::tile_rendering::rendered_tile;

/// How long a client may use a tile without asking, seconds.
const FRESH: HeaderValue = HeaderValue::from_static("private, max-age=300");

/// Where the tiles of a map are (TileJSON 3.0.0).
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct TileJson {
    /// Version of TileJSON.
    tilejson: &'static str,
    /// The id of the map.
    name: String,
    /// Addresses of tiles, with `{z}`, `{x}` and `{y}`.
    tiles: Vec<String>,
    /// Row 0 is in the north.
    scheme: &'static str,
    /// Coarsest zoom.
    minzoom: u32,
    /// Finest zoom that shows more than the one before.
    maxzoom: u32,
    /// West, south, east, north, degrees; all longitudes for a map that crosses the antimeridian.
    bounds: [f64; 4],
}

/// Describes the tiles of a map
#[utoipa::path(
    get, path = "/v1/maps/{id}/tilejson.json", tag = "maps",
    params(("id" = String, Path, description = "The map")),
    responses((status = 200, description = "TileJSON 3.0.0", body = TileJson))
)]
pub(crate) async fn tilejson(
    axum::extract::State(state): Shared,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Json<TileJson>, Problem> {
    let map = state.maps.get(&id)?;
    let host = host_of(&uri, &headers).unwrap_or_default();
    let [minzoom, maxzoom] = map.zooms();
    Ok(Json(TileJson {
        tilejson: "3.0.0",
        name: map.id().to_owned(),
        tiles: vec![format!(
            "{}://{host}/v1/maps/{}/tiles/{{z}}/{{x}}/{{y}}",
            scheme_of(&headers),
            map.id()
        )],
        scheme: "xyz",
        minzoom,
        maxzoom,
        bounds: bounds(map.bounds_deg()),
    }))
}

/// The bounds of a map as TileJSON (3.3) wants them: from -180 to 180 degrees, and not over the antimeridian.
fn bounds([west, south, east, north]: [f64; 4]) -> [f64; 4] {
    if east > 180.0 {
        [-180.0, south, 180.0, north]
    } else {
        [west, south, east, north]
    }
}

/// A tile of a map
///
/// XYZ in Web Mercator, 256 px: JPEG, or PNG where it is partly transparent. Without a map the tiles show the outlines of the pack.
#[utoipa::path(
    get, path = "/v1/maps/{id}/tiles/{z}/{x}/{y}", tag = "maps",
    params(
        ("id" = String, Path, description = "The map"),
        ("z" = u32, Path, description = "Zoom"),
        ("x" = u32, Path, description = "Column"),
        ("y" = String, Path, description = "Row, 0 in the north; an ending .png or .jpg is ignored"),
        ("layer" = Option<String>, Query, description = "`map` or `outlines`"),
    ),
    responses((status = 200, description = "The tile", content((crate::openapi::Binary = "image/jpeg"), (crate::openapi::Binary = "image/png"))))
)]
pub(crate) async fn tile(
    axum::extract::State(state): Shared,
    Path((id, z, x, y)): Path<(String, String, String, String)>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let map = state.maps.get(&id)?;
    let mut query = Query::of(&uri)?;
    let layer = match query.take("layer")?.as_deref() {
        Some("outlines") => Layer::Outlines,
        None if map.raster.is_none() => Layer::Outlines,
        None | Some("map") => Layer::Map,
        Some(other) => {
            return Err(Problem::bad_request(format!(
                "layer is {other:?}; expected `map` or `outlines`"
            )));
        }
    };
    let [minzoom, _] = map.zooms();
    let address = address(&z, &x, &y)
        .filter(|address| address.zoom() >= minzoom)
        .ok_or_else(|| {
            Problem::not_found(format!(
                "there is no tile {z}/{x}/{y}; zooms go from {minzoom} to {MAX_ZOOM}"
            ))
        })?;
    let tile = tile_of(&state, &id, layer, address).await?;
    let mut response = if is_known(&headers, &tile.tag) {
        StatusCode::NOT_MODIFIED.into_response()
    } else {
        tile.bytes.into_response()
    };
    let headers = response.headers_mut();
    headers.insert(
        header::CONTENT_TYPE,
        HeaderValue::from_static(tile.media_type),
    );
    headers.insert(header::ETAG, tile.tag);
    headers.insert(header::CACHE_CONTROL, FRESH);
    Ok(response)
}

/// A tile of a map that there is.
///
/// # Errors
/// Status 500 if it cannot be read.
pub(crate) async fn tile_of(
    state: &Arc<State>,
    id: &str,
    layer: Layer,
    address: TileAddress,
) -> Result<Tile, Problem> {
    let key = (id.to_owned(), layer, address);
    if let Some(tile) = state.tiles.get(&key) {
        return Ok(tile);
    }
    let id = id.to_owned();
    let tile = in_background(state, move |state| {
        let map = state.maps.get(&id)?;
        rendered_tile(map, layer, address).map_err(|error| {
            tracing::error!(%error, "a tile cannot be made");
            Problem::internal()
        })
    })
    .await?;
    state.tiles.insert(key, tile.clone());
    Ok(tile)
}

/// The tile that three parts of a path name.
fn address(z: &str, x: &str, y: &str) -> Option<TileAddress> {
    let y = y
        .strip_suffix(".png")
        .or_else(|| y.strip_suffix(".jpg"))
        .unwrap_or(y);
    let number = |text: &str| {
        let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        if digits {
            text.parse::<u32>().ok()
        } else {
            None
        }
    };
    TileAddress::new(number(z)?, number(x)?, number(y)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_end_at_the_antimeridian() {
        let inside = [178.0, -17.5, 180.0, -17.0];
        assert_eq!(bounds(inside), inside);
        let across = bounds([179.5, -17.5, 180.5, -17.0]);
        assert_eq!(across, [-180.0, -17.5, 180.0, -17.0]);
    }

    #[test]
    fn addresses_are_numbers() {
        assert_eq!(address("3", "1", "2.png"), TileAddress::new(3, 1, 2));
        for bad in ["", "-1", "+1", "1e3", "..", "2.gif", "99999999999"] {
            assert_eq!(address("3", "1", bad), None, "{bad}");
        }
    }
}
