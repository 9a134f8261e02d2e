//! `/v1/tracks`: frames of a flight in, its track out.

use std::sync::Arc;

use axum::Json;
use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use grimnet_answer::Answer;
use grimnet_flight::{Flight, FlightOptions, Known};
use grimnet_locate::{LocateError, Prior};
use grimnet_photo::PhotoError;
use serde::{Deserialize, Serialize};

use crate::answer_type::AnswerType;
use crate::background::in_background;
use crate::locate_route::problem_of_locate;
use crate::path::Path;
use crate::photo::decode;
use crate::problem::{Problem, ProblemKind};
use crate::query::Query;
use crate::request_body::{of_json, read_body};
use crate::state::{Shared, State};
use crate::track_formats::{geojson, gpx};
use crate::track_frame::TrackFrame;
use crate::track_store::{Track, TrackSummary};
use crate::upload::Upload;

/// Largest and smallest time that a frame may have, seconds: times of every usual clock are within.
const MAX_TIME_S: f64 = 1e12;

/// Largest description of a new track, bytes.
const MAX_NEW_TRACK_BYTES: usize = 16 << 10;

/// What a track can be; GeoJSON unless the client says otherwise, and it is JSON.
const OFFERED: [AnswerType; 3] = [AnswerType::Geojson, AnswerType::Gpx, AnswerType::Json];

/// What a new track is on.
#[derive(Debug, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NewTrack {
    /// The map; it may be left out if there is only one.
    map: Option<String>,
}

/// The tracks of the service.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct TrackList {
    /// The tracks, oldest first.
    tracks: Vec<TrackSummary>,
}

/// Begins a track
#[utoipa::path(post, path = "/v1/tracks", tag = "tracks", request_body = Option<NewTrack>, responses((status = 201, description = "The track", body = TrackSummary)))]
pub(crate) async fn begin(
    axum::extract::State(state): Shared,
    uri: Uri,
    request: Request,
) -> Result<Response, Problem> {
    if !Query::of(&uri)?.is_empty() {
        return Err(Problem::bad_request(
            "the address has a query; expected what the track is on in the body, such as {\"map\": \"town\"}",
        ));
    }
    let body = read_body(
        request.into_body(),
        MAX_NEW_TRACK_BYTES,
        &state.limits,
        None,
    )
    .await?;
    let new: Option<NewTrack> = if body.is_empty() {
        None
    } else {
        of_json(&body)
            .map_err(|error| Problem::bad_request(format!("the body is not understood: {error}")))?
    };
    let map = new.and_then(|new| new.map);
    let map = state.maps.get_or_only(map.as_deref())?;
    let flight = Flight::new(map.localizer.clone(), FlightOptions::default()).map_err(|error| {
        tracing::error!(%error, "a track cannot begin");
        Problem::internal()
    })?;
    let track = state.tracks.begin(map.id(), flight)?;
    let location = HeaderValue::from_str(&format!("/v1/tracks/{}", track.id));
    let mut response = (StatusCode::CREATED, Json(track.summary())).into_response();
    if let Ok(location) = location {
        response.headers_mut().insert(header::LOCATION, location);
    }
    Ok(response)
}

/// Lists the tracks
#[utoipa::path(get, path = "/v1/tracks", tag = "tracks", responses((status = 200, description = "The tracks", body = TrackList)))]
pub(crate) async fn list(axum::extract::State(state): Shared) -> Json<TrackList> {
    Json(TrackList {
        tracks: state.tracks.summaries(),
    })
}

/// Ends a track
#[utoipa::path(delete, path = "/v1/tracks/{id}", tag = "tracks", params(("id" = u64, Path, description = "The track")), responses((status = 204, description = "It is ended")))]
pub(crate) async fn end(
    axum::extract::State(state): Shared,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    let track = state.tracks.get(&id)?;
    state.tracks.end(&track);
    Ok(StatusCode::NO_CONTENT)
}

/// A track
///
/// GeoJSON: lines through the usable positions (a `MultiLineString`), and each position with its state, covariance and radius. GPX: the
/// usable positions. Lines and segments end at every frame without a usable position.
#[utoipa::path(
    get, path = "/v1/tracks/{id}", tag = "tracks", params(("id" = u64, Path, description = "The track")),
    responses((status = 200, description = "The track", content(
        (crate::openapi::GeoJson = "application/geo+json"), (String = "application/gpx+xml"), (crate::openapi::GeoJson = "application/json"),
    )))
)]
pub(crate) async fn track(
    axum::extract::State(state): Shared,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let track = state.tracks.get(&id)?;
    let kind = AnswerType::accepted(&headers, &OFFERED)?;
    let text = in_background(&state, move |_| {
        let frames = track.frames();
        Ok(match kind {
            AnswerType::Gpx => gpx(track.id, &frames),
            _ => geojson(&frames),
        })
    })
    .await?;
    let text = state.conversions.hold(text)?;
    let content_type = HeaderValue::from_static(kind.media_type());
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
}

/// Takes in a frame
///
/// The body is as for `/v1/locate`. Frames are taken in one after the other; each is searched where the track says. A frame of a
/// time that the track has already is not looked at, and answered with what the first one gave: it may be sent again. A frame that is
/// refused is not kept.
#[utoipa::path(
    post, path = "/v1/tracks/{id}/frames", tag = "tracks",
    params(
        ("id" = u64, Path, description = "The track"),
        ("time_s" = f64, Query, description = "Time of the exposure, seconds on one clock for all frames"),
        ("name" = Option<String>, Query, description = "Name of the photo in the answer"),
        crate::prior_fields::PriorFields,
    ),
    request_body(content(
        (crate::openapi::LocateForm = "multipart/form-data"),
        (crate::openapi::Binary = "image/jpeg"),
        (crate::openapi::Binary = "image/png"),
        (crate::openapi::Binary = "image/tiff"),
        (crate::openapi::Binary = "image/webp"),
        (crate::openapi::Binary = "application/octet-stream"),
    )),
    responses((status = 200, description = "What it gave", body = TrackFrame))
)]
pub(crate) async fn frame(
    axum::extract::State(state): Shared,
    Path(id): Path<String>,
    uri: Uri,
    request: Request,
) -> Result<Json<TrackFrame>, Problem> {
    let track = state.tracks.get(&id)?;
    let mut query = Query::of(&uri)?;
    let time_s = time_of(query.take("time_s")?.as_deref())?;
    let name = query.take("name")?;
    let arrival = state.localisations.arrive()?;
    let upload = Upload::read(request, &state.limits, &arrival).await?;
    let prior = upload.prior(&query)?;
    let name = upload
        .name(name.as_deref())
        .unwrap_or_else(|| format!("frame at {time_s} s"));
    let place = arrival.enter(&state.limits)?;
    let Some(Ok(turn)) = place.wait(track.turn.clone().acquire_owned()).await else {
        return Err(Problem::unavailable(
            ProblemKind::Busy,
            "the frames of this track before this one take too long; send fewer",
            1,
        ));
    };
    let shared = state.clone();
    let work = move || {
        let _turn = turn;
        take_in(&shared, &track, &name, &upload.photo, time_s, prior)
    };
    let frame = place.run(work).await??;
    Ok(Json(TrackFrame::clone(&frame)))
}

/// The time of a frame, seconds.
///
/// # Errors
/// Status 400 if it is not given, no number or out of range, as a time in microseconds is.
fn time_of(text: Option<&str>) -> Result<f64, Problem> {
    let expected = format!(
        "expected the time of the exposure in seconds, {:e} to {MAX_TIME_S:e}",
        -MAX_TIME_S
    );
    let Some(text) = text else {
        return Err(Problem::bad_request(format!(
            "the query has no time_s; {expected}"
        )));
    };
    let time_s = text.parse::<f64>().ok();
    time_s
        .filter(|time_s| time_s.abs() <= MAX_TIME_S)
        .ok_or_else(|| Problem::bad_request(format!("time_s is {text:?}; {expected}")))
}

/// Decodes a frame and gives it to the flight, unless there is one of its time. This takes long.
fn take_in(
    state: &Arc<State>,
    track: &Track,
    name: &str,
    bytes: &[u8],
    time_s: f64,
    prior: Prior,
) -> Result<Arc<TrackFrame>, Problem> {
    if let Some(frame) = track.at(time_s) {
        tracing::info!(track = track.id, number = frame.number, "a repeated frame");
        return Ok(frame);
    }
    let start = std::time::Instant::now();
    let needed = track.flight().localizer().needed_pixels(&prior);
    let photo = decode(needed, name, bytes, &state.limits)?;
    let known = Known {
        prior,
        attitude: None,
    };
    let (found, is_after_restart) = {
        let mut flight = track.flight();
        let restarts = flight.tracker().counts().restarts;
        let found = flight.frame(&photo, time_s, &known);
        (found, flight.tracker().counts().restarts != restarts)
    };
    let answer = match &found.outcome {
        Ok(outcome) => Answer::of(name, outcome),
        // So the camera looked: no other request could say it better, and the flight goes on.
        Err(error @ LocateError::Photo(PhotoError::Horizon { .. })) => Answer::no_fix(name, error),
        // The frame is not kept, and may be sent with another prior.
        Err(error) => return Err(problem_of_locate(error)),
    };
    let is_fix = answer.reason.is_none();
    state.metrics.answer(&track.map, is_fix, start.elapsed());
    tracing::info!(
        track = track.id,
        state = if is_fix { "fix" } else { "no_fix" },
        ms = start.elapsed().as_millis() as u64,
        "frame"
    );
    // It gets its number there.
    let frame = TrackFrame::new(0, time_s, &found.searched, found.point, answer);
    Ok(track.add(frame, is_after_restart))
}
