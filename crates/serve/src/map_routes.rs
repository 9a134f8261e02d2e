//! `GET /v1/maps`: what can be localised on.

use axum::Json;
use serde::Serialize;

use crate::maps::{MapSummary, ServedMap};
use crate::state::Shared;

/// The maps of the service.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct MapList {
    /// The maps, in the order in which the service was given them.
    maps: Vec<MapSummary>,
}

/// Lists the maps
#[utoipa::path(get, path = "/v1/maps", tag = "maps", responses((status = 200, description = "The maps", body = MapList)))]
pub(crate) async fn maps(axum::extract::State(state): Shared) -> Json<MapList> {
    Json(MapList {
        maps: state.maps.iter().map(ServedMap::summary).collect(),
    })
}
