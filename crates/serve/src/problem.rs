//! Errors as clients see them: problem details (RFC 9457).

use axum::Json;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// Media type of [`Problem`]s.
pub(crate) const MEDIA_TYPE: &str = "application/problem+json";

/// What went wrong with a request (RFC 9457).
#[derive(Debug, Clone, PartialEq, Serialize, utoipa::ToSchema)]
pub(crate) struct Problem {
    /// Which kind of problem: `urn:grimnet:problem:` and a name that does not change.
    #[serde(rename = "type")]
    kind: String,
    /// The kind in words.
    title: &'static str,
    /// The status code of the answer.
    status: u16,
    /// What was wrong, what was expected, and what to do.
    detail: String,
    #[serde(skip)]
    headers: Vec<(HeaderName, String)>,
}

impl Problem {
    /// A problem of the kind `name`.
    pub(crate) fn new(
        status: StatusCode,
        name: &str,
        title: &'static str,
        detail: impl std::fmt::Display,
    ) -> Self {
        Self {
            kind: format!("urn:grimnet:problem:{name}"),
            title,
            status: status.as_u16(),
            detail: detail.to_string(),
            headers: Vec::new(),
        }
    }

    /// A request that is not understood.
    pub(crate) fn bad_request(detail: impl std::fmt::Display) -> Self {
        Self::new(
            StatusCode::BAD_REQUEST,
            "bad-request",
            "The request is not understood",
            detail,
        )
    }

    /// A value that is out of range or contradicts another one.
    pub(crate) fn bad_value(detail: impl std::fmt::Display) -> Self {
        Self::new(
            StatusCode::UNPROCESSABLE_ENTITY,
            "bad-value",
            "A value cannot be used",
            detail,
        )
    }

    /// A body of a type that is not supported.
    pub(crate) fn unsupported(detail: impl std::fmt::Display) -> Self {
        Self::new(
            StatusCode::UNSUPPORTED_MEDIA_TYPE,
            "unsupported-media-type",
            "This type of content is not supported",
            detail,
        )
    }

    /// A body or a picture above its limit.
    pub(crate) fn too_large(detail: impl std::fmt::Display) -> Self {
        Self::new(
            StatusCode::PAYLOAD_TOO_LARGE,
            "too-large",
            "The request is too large",
            detail,
        )
    }

    /// Nothing is at this address.
    pub(crate) fn not_found(detail: impl std::fmt::Display) -> Self {
        Self::new(StatusCode::NOT_FOUND, "not-found", "Not found", detail)
    }

    /// A client that sends too slowly.
    pub(crate) fn too_slow(detail: impl std::fmt::Display) -> Self {
        Self::new(
            StatusCode::REQUEST_TIMEOUT,
            "too-slow",
            "The request did not arrive in time",
            detail,
        )
        .with_header(header::CONNECTION, "close")
    }

    /// Something that is taken now, and may be free after `retry_after_s` seconds.
    pub(crate) fn unavailable(
        name: &str,
        title: &'static str,
        detail: impl std::fmt::Display,
        retry_after_s: u64,
    ) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, name, title, detail)
            .with_header(header::RETRY_AFTER, retry_after_s)
    }

    /// The fault is the service's. What happened is logged and not told.
    pub(crate) fn internal() -> Self {
        Self::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            "internal",
            "The service failed",
            "the service failed at this request; its log says why",
        )
    }

    /// The same problem with a header.
    pub(crate) fn with_header(mut self, name: HeaderName, value: impl std::fmt::Display) -> Self {
        self.headers.push((name, value.to_string()));
        self
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let extra = self.headers.clone();
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(MEDIA_TYPE));
        for (name, value) in extra {
            if let Ok(value) = HeaderValue::from_str(&value) {
                headers.insert(name, value);
            }
        }
        response
    }
}
