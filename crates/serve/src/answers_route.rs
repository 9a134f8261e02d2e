//! `POST /v1/answers`: answers in another format.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use grimnet_answer::{Answer, text_of};

use crate::accept::AnswerType;
use crate::problem::Problem;
use crate::state::Shared;
use crate::upload::read_body;

/// Largest list of answers, bytes: thousands of them.
const MAX_ANSWERS_BYTES: usize = 8 << 20;

/// What a list of answers can be; JSON lines unless the client says otherwise.
const OFFERED: [AnswerType; 6] = [
    AnswerType::JsonLines,
    AnswerType::Json,
    AnswerType::Geojson,
    AnswerType::Kml,
    AnswerType::Gpx,
    AnswerType::Csv,
];

/// Writes answers in another format
///
/// A list of answers of `/v1/locate`, for a file of all of them. `application/json` is a list again, `application/x-ndjson` a line
/// for each answer.
#[utoipa::path(
    post, path = "/v1/answers", tag = "locate",
    request_body = Vec<Answer>,
    responses((status = 200, description = "The answers", content(
        (String = "application/x-ndjson"),
        (Vec<Answer> = "application/json"),
        (String = "application/geo+json"),
        (String = "application/vnd.google-earth.kml+xml"),
        (String = "application/gpx+xml"),
        (String = "text/csv"),
    )))
)]
pub(crate) async fn answers(
    axum::extract::State(state): Shared,
    headers: HeaderMap,
    request: Request,
) -> Result<Response, Problem> {
    let kind = AnswerType::accepted(&headers, &OFFERED)?;
    let bytes = read_body(request.into_body(), MAX_ANSWERS_BYTES, &state.limits).await?;
    let answers: Vec<Answer> = serde_json::from_slice(&bytes).map_err(|error| {
        Problem::bad_request(format!("the body is no list of answers: {error}"))
    })?;
    let text = match kind {
        AnswerType::Json => serde_json::to_string(&answers).map_err(|error| error.to_string()),
        kind => text_of(kind.format().as_mut(), &answers).map_err(|error| error.to_string()),
    };
    let text = text.map_err(|error| {
        tracing::error!(error, "answers cannot be written");
        Problem::internal()
    })?;
    let content_type = HeaderValue::from_static(kind.media_type());
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
}
