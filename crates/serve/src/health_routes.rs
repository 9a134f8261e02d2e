//! Whether the service lives, and its figures.

use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};

use crate::state::Shared;

/// Media type of Prometheus' text format.
const PROMETHEUS: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Whether the service lives
#[utoipa::path(get, path = "/healthz", tag = "service", responses((status = 200, description = "It lives", body = String, content_type = "text/plain")))]
pub(crate) async fn health() -> &'static str {
    "ok\n"
}

/// Figures for Prometheus
#[utoipa::path(get, path = "/metrics", tag = "service", responses((status = 200, description = "Counts and times", body = String, content_type = "text/plain")))]
pub(crate) async fn metrics(axum::extract::State(state): Shared) -> Response {
    let text = state.metrics.text(&state.localisations, &state.conversions);
    let content_type = HeaderValue::from_static(PROMETHEUS);
    ([(header::CONTENT_TYPE, content_type)], text).into_response()
}
