//! `POST /v1/answers`: answers in another format.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use grimnet_answer::{Answer, text_of};

use crate::accept::AnswerType;
use crate::problem::Problem;

/// Largest list of answers, bytes: thousands of them.
pub(crate) const MAX_ANSWERS_BYTES: usize = 8 << 20;

/// Writes answers in another format
///
/// A list of answers of `/v1/locate`, for a file of all of them.
#[utoipa::path(
    post, path = "/v1/answers", tag = "locate",
    request_body = Vec<Answer>,
    responses((status = 200, description = "The answers", content(
        (String = "application/x-ndjson"),
        (String = "application/geo+json"),
        (String = "application/vnd.google-earth.kml+xml"),
        (String = "application/gpx+xml"),
        (String = "text/csv"),
    )))
)]
pub(crate) async fn answers(headers: HeaderMap, request: Request) -> Result<Response, Problem> {
    let kind = AnswerType::accepted(&headers)?;
    let bytes = axum::body::to_bytes(request.into_body(), MAX_ANSWERS_BYTES)
        .await
        .map_err(|_| {
            Problem::too_large(format!(
                "the list breaks off or is longer than the limit of {MAX_ANSWERS_BYTES} bytes"
            ))
        })?;
    let answers: Vec<Answer> = serde_json::from_slice(&bytes).map_err(|error| {
        Problem::bad_request(format!("the body is no list of answers: {error}"))
    })?;
    let text = text_of(kind.format().as_mut(), &answers).map_err(|error| {
        tracing::error!(%error, "answers cannot be written");
        Problem::internal()
    })?;
    let content_type = HeaderValue::from_static(kind.media_type());
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
}
