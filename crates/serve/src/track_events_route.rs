//! `GET /v1/tracks/{id}/events`: frames of a track as they come (server-sent events, WHATWG HTML 9.2).

use std::convert::Infallible;
use std::sync::Arc;

use axum::http::HeaderMap;
use axum::response::IntoResponse;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::stream::{Stream, unfold};
use tokio::sync::{OwnedSemaphorePermit, watch};

use crate::path::Path;
use crate::problem::{Problem, ProblemKind};
use crate::state::Shared;
use crate::track_store::Track;

/// Where a browser says what it has got.
const LAST_EVENT_ID: &str = "last-event-id";

/// Asks proxies (nginx and others) to pass events on as they come; they would keep them back until they have a few kilobytes.
const UNBUFFERED: [(&str, &str); 1] = [("x-accel-buffering", "no")];

/// Seconds after which a client may ask for the place of another one: nobody knows when that ends.
const LISTENER_RETRY_S: u64 = 10;

/// Follows a track
///
/// Each frame is an event `frame` whose data is what `POST .../frames` answers and whose id is the frame's number. The header
/// `Last-Event-ID` resumes after a frame; without it all frames that are kept come first. The events end when the track does.
#[utoipa::path(
    get, path = "/v1/tracks/{id}/events", tag = "tracks",
    params(
        ("id" = u64, Path, description = "The track"),
        ("last-event-id" = Option<u64>, Header, description = "Number of the last frame that the client has"),
    ),
    responses((status = 200, description = "The events", body = String, content_type = "text/event-stream"))
)]
pub(crate) async fn events(
    axum::extract::State(state): Shared,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<impl IntoResponse, Problem> {
    let track = state.tracks.get(&id)?;
    let after = match headers.get(LAST_EVENT_ID) {
        None => 0,
        Some(value) => value
            .to_str()
            .ok()
            .and_then(|text| text.trim().parse().ok())
            .ok_or_else(|| Problem::bad_request("Last-Event-ID is not the number of a frame"))?,
    };
    let Ok(place) = state.listeners.clone().try_acquire_owned() else {
        return Err(Problem::unavailable(
            ProblemKind::Listeners,
            "no further client can follow a track now; one may when another has ended",
            LISTENER_RETRY_S,
        ));
    };
    let stream = frames(Listener {
        latest: track.listen(),
        ended: track.listen_for_end(),
        track,
        after,
        stopping: state.stopping.clone(),
        _place: place,
    });
    Ok((
        UNBUFFERED,
        Sse::new(stream).keep_alive(KeepAlive::default()),
    ))
}

/// One client that follows a track.
struct Listener {
    track: Arc<Track>,
    /// Number of the last frame that was sent.
    after: u64,
    latest: watch::Receiver<u64>,
    ended: watch::Receiver<bool>,
    stopping: watch::Receiver<bool>,
    _place: OwnedSemaphorePermit,
}

fn frames(listener: Listener) -> impl Stream<Item = Result<Event, Infallible>> {
    unfold(listener, |mut listener| async move {
        loop {
            if *listener.stopping.borrow() {
                return None;
            }
            listener.latest.mark_unchanged();
            if let Some(frame) = listener.track.next_after(listener.after) {
                listener.after = frame.number;
                let event = Event::default()
                    .event("frame")
                    .id(frame.number.to_string())
                    .json_data(&*frame)
                    .ok()?;
                return Some((Ok(event), listener));
            }
            if *listener.ended.borrow() {
                return None;
            }
            tokio::select! {
                changed = listener.latest.changed() => changed.ok()?,
                ended = listener.ended.changed() => ended.ok()?,
                stopped = listener.stopping.changed() => stopped.ok()?,
            }
        }
    })
}
