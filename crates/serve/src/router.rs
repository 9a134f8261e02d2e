//! Which address does what.

use std::sync::Arc;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::{Method, Uri};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post};

use crate::answers_route::answers;
use crate::assets;
use crate::health_routes::{health, metrics};
use crate::lingering_close::close_after_refusal;
use crate::locate_route::locate;
use crate::map_routes::maps;
use crate::openapi::document;
use crate::problem::{Problem, ProblemKind};
use crate::protection::protect;
use crate::request_log::log_request;
use crate::state::State;
use crate::tile_routes::{tile, tilejson};
use crate::track_events_route::events;
use crate::track_routes::{begin, end, frame, list, track};
use crate::track_session_route::session;

/// The router of the service.
pub(crate) fn router(state: Arc<State>) -> Router {
    let max_body_bytes = state.limits.max_body_bytes;
    Router::new()
        .route("/v1/locate", post(locate))
        .route("/v1/answers", post(answers))
        .route("/v1/maps", get(maps))
        .route("/v1/maps/{id}/tilejson.json", get(tilejson))
        .route("/v1/maps/{id}/tiles/{z}/{x}/{y}", get(tile))
        .route("/v1/tracks", get(list).post(begin))
        .route("/v1/tracks/{id}", get(track).delete(end))
        .route("/v1/tracks/{id}/frames", post(frame))
        .route("/v1/tracks/{id}/events", get(events))
        .route("/v1/tracks/{id}/session", get(session))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .route("/openapi.json", get(document))
        .merge(assets::routes())
        .method_not_allowed_fallback(method_not_allowed)
        .fallback(not_found)
        .layer(DefaultBodyLimit::max(max_body_bytes))
        .layer(from_fn_with_state(state.clone(), protect))
        .layer(from_fn(close_after_refusal))
        .layer(from_fn_with_state(state.clone(), log_request))
        .with_state(state)
}

async fn not_found(uri: Uri) -> Problem {
    Problem::not_found(format!(
        "there is nothing at {}; /openapi.json lists what there is",
        uri.path()
    ))
}

async fn method_not_allowed(method: Method) -> Problem {
    Problem::new(
        ProblemKind::MethodNotAllowed,
        format!("the method is {method}; the header Allow lists the possible ones"),
    )
}
