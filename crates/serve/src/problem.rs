//! Errors as clients see them: problem details (RFC 9457).

use axum::Json;
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;

/// Media type of [`Problem`]s.
pub(crate) const MEDIA_TYPE: &str = "application/problem+json";

/// Which kind of problem. Clients rely on the names: they do not change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ProblemKind {
    BadRequest,
    Token,
    Origin,
    NotFound,
    MethodNotAllowed,
    NotAcceptable,
    TooSlow,
    TooLarge,
    UnsupportedMediaType,
    Host,
    BadValue,
    Internal,
    Busy,
    TimeLimit,
    Tracks,
    Listeners,
}

impl ProblemKind {
    /// Status of the answer, name and title.
    fn parts(self) -> (StatusCode, &'static str, &'static str) {
        match self {
            Self::BadRequest => (
                StatusCode::BAD_REQUEST,
                "bad-request",
                "The request is not understood",
            ),
            Self::Token => (StatusCode::UNAUTHORIZED, "token", "A token is required"),
            Self::Origin => (
                StatusCode::FORBIDDEN,
                "origin",
                "Pages of other sites may not ask",
            ),
            Self::NotFound => (StatusCode::NOT_FOUND, "not-found", "Not found"),
            Self::MethodNotAllowed => (
                StatusCode::METHOD_NOT_ALLOWED,
                "method-not-allowed",
                "This method is not possible here",
            ),
            Self::NotAcceptable => (
                StatusCode::NOT_ACCEPTABLE,
                "not-acceptable",
                "No format of the answer is accepted",
            ),
            Self::TooSlow => (
                StatusCode::REQUEST_TIMEOUT,
                "too-slow",
                "The request did not arrive in time",
            ),
            Self::TooLarge => (
                StatusCode::PAYLOAD_TOO_LARGE,
                "too-large",
                "The request is too large",
            ),
            Self::UnsupportedMediaType => (
                StatusCode::UNSUPPORTED_MEDIA_TYPE,
                "unsupported-media-type",
                "This type of content is not supported",
            ),
            Self::Host => (
                StatusCode::MISDIRECTED_REQUEST,
                "host",
                "The request is for another host",
            ),
            Self::BadValue => (
                StatusCode::UNPROCESSABLE_ENTITY,
                "bad-value",
                "A value cannot be used",
            ),
            Self::Internal => (
                StatusCode::INTERNAL_SERVER_ERROR,
                "internal",
                "The service failed",
            ),
            Self::Busy => (
                StatusCode::SERVICE_UNAVAILABLE,
                "busy",
                "The service is busy",
            ),
            Self::TimeLimit => (
                StatusCode::SERVICE_UNAVAILABLE,
                "time-limit",
                "The request took too long",
            ),
            Self::Tracks => (
                StatusCode::SERVICE_UNAVAILABLE,
                "tracks",
                "There are too many tracks",
            ),
            Self::Listeners => (
                StatusCode::SERVICE_UNAVAILABLE,
                "listeners",
                "Too many clients follow tracks",
            ),
        }
    }
}

/// What went wrong with a request (RFC 9457).
#[derive(Debug, Clone, PartialEq, Serialize, thiserror::Error, utoipa::ToSchema)]
#[error("{detail}")]
pub(crate) struct Problem {
    /// Which kind of problem: `urn:grimnet:problem:` and a name that does not change. The names are `bad-request`, `token`, `origin`,
    /// `not-found`, `method-not-allowed`, `not-acceptable`, `too-slow`, `too-large`, `unsupported-media-type`, `host`, `bad-value`,
    /// `internal`, `busy`, `time-limit`, `tracks` and `listeners`.
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
    /// A problem of a kind.
    pub(crate) fn new(kind: ProblemKind, detail: impl std::fmt::Display) -> Self {
        let (status, name, title) = kind.parts();
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
        Self::new(ProblemKind::BadRequest, detail)
    }

    /// A value that is out of range or contradicts another one.
    pub(crate) fn bad_value(detail: impl std::fmt::Display) -> Self {
        Self::new(ProblemKind::BadValue, detail)
    }

    /// A body of a type that is not supported.
    pub(crate) fn unsupported(detail: impl std::fmt::Display) -> Self {
        Self::new(ProblemKind::UnsupportedMediaType, detail)
    }

    /// A body or a picture above its limit.
    pub(crate) fn too_large(detail: impl std::fmt::Display) -> Self {
        Self::new(ProblemKind::TooLarge, detail)
    }

    /// Nothing is at this address.
    pub(crate) fn not_found(detail: impl std::fmt::Display) -> Self {
        Self::new(ProblemKind::NotFound, detail)
    }

    /// A client that sends too slowly.
    pub(crate) fn too_slow(detail: impl std::fmt::Display) -> Self {
        Self::new(ProblemKind::TooSlow, detail)
    }

    /// Something that is taken now, and may be free after `retry_after_s` seconds.
    pub(crate) fn unavailable(
        kind: ProblemKind,
        detail: impl std::fmt::Display,
        retry_after_s: u64,
    ) -> Self {
        Self::new(kind, detail).with_header(header::RETRY_AFTER, retry_after_s)
    }

    /// The fault is the service's. What happened is in the log and not in the answer.
    pub(crate) fn internal() -> Self {
        Self::new(
            ProblemKind::Internal,
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

#[cfg(test)]
mod tests {
    use utoipa::PartialSchema as _;

    use super::*;

    const ALL: [ProblemKind; 16] = [
        ProblemKind::BadRequest,
        ProblemKind::Token,
        ProblemKind::Origin,
        ProblemKind::NotFound,
        ProblemKind::MethodNotAllowed,
        ProblemKind::NotAcceptable,
        ProblemKind::TooSlow,
        ProblemKind::TooLarge,
        ProblemKind::UnsupportedMediaType,
        ProblemKind::Host,
        ProblemKind::BadValue,
        ProblemKind::Internal,
        ProblemKind::Busy,
        ProblemKind::TimeLimit,
        ProblemKind::Tracks,
        ProblemKind::Listeners,
    ];

    #[test]
    fn every_kind_is_described() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/service.md");
        let page = std::fs::read_to_string(path).unwrap();
        let schema = serde_json::to_value(Problem::schema()).unwrap();
        let described = schema["properties"]["type"]["description"]
            .as_str()
            .unwrap();
        for kind in ALL {
            let (status, name, _) = kind.parts();
            let row = format!("| {} | `{name}` |", status.as_u16());
            assert!(page.contains(&row), "docs/service.md should hold:\n{row}");
            assert!(described.contains(&format!("`{name}`")), "{described}");
        }
    }
}
