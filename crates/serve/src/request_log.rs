//! One line in the log and one count for each request.

use std::sync::atomic::Ordering;
use std::time::Instant;

use axum::extract::{MatchedPath, Request};
use axum::middleware::Next;
use axum::response::Response;

use crate::state::{Shared, State};

/// The route of requests that match none.
const NO_ROUTE: &str = "none";

/// Logs and counts a request when its answer begins, or when its client leaves before.
pub(crate) async fn log_request(
    axum::extract::State(state): Shared,
    request: Request,
    next: Next,
) -> Response {
    let start = Instant::now();
    // Unknown methods are one for the counts: a client could invent any number of them.
    let method = match request.method().as_str() {
        known @ ("GET" | "HEAD" | "POST" | "PUT" | "DELETE" | "OPTIONS" | "PATCH") => known,
        _ => "other",
    }
    .to_owned();
    let route = request
        .extensions()
        .get::<MatchedPath>()
        .map_or_else(|| NO_ROUTE.to_owned(), |path| path.as_str().to_owned());
    let mut unanswered = Unanswered {
        state: &state,
        method: &method,
        route: &route,
        start,
        is_answered: false,
    };
    let response = next.run(request).await;
    unanswered.is_answered = true;
    drop(unanswered);
    let status = response.status().as_u16();
    state.metrics.request(&method, &route, status);
    let ms = start.elapsed().as_millis() as u64;
    if status >= 500 {
        tracing::warn!(method, route, status, ms, "request");
    } else {
        tracing::info!(method, route, status, ms, "request");
    }
    response
}

/// A request before its answer. If it is dropped then, its client has left.
struct Unanswered<'a> {
    state: &'a State,
    method: &'a str,
    route: &'a str,
    start: Instant,
    is_answered: bool,
}

impl Drop for Unanswered<'_> {
    fn drop(&mut self) {
        if self.is_answered {
            return;
        }
        self.state.metrics.left.fetch_add(1, Ordering::Relaxed);
        let ms = self.start.elapsed().as_millis() as u64;
        let Self { method, route, .. } = *self;
        tracing::info!(method, route, ms, "the client left before the answer");
    }
}
