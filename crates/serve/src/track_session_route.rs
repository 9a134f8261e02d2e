//! `GET /v1/tracks/{id}/session`: a track with its map as one HTML file.

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};

use crate::background::in_background;
use crate::path::Path;
use crate::problem::Problem;
use crate::session_page::{page_of_tiles, session_layer, session_tiles};
use crate::state::Shared;
use crate::tile_routes::tile_of;
use crate::track_frame::TrackFrame;

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
    let layer = session_layer(map);
    let mut tiles = Vec::new();
    for address in session_tiles(map) {
        tiles.push((address, tile_of(&state, map.id(), layer, address).await?));
    }
    let disposition = format!("attachment; filename=\"track-{}.html\"", track.id);
    let text = in_background(&state, move |state| {
        let map = state.maps.get(&track.map)?;
        let title = format!("Track {} on {}", track.id, map.id());
        let frames = track.frames();
        let frames: Vec<&TrackFrame> = frames.iter().map(AsRef::as_ref).collect();
        page_of_tiles(&title, map, &tiles, &frames).map_err(|error| {
            tracing::error!(%error, "a session cannot be written");
            Problem::internal()
        })
    })
    .await?;
    let text = state.conversions.hold(text)?;
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
