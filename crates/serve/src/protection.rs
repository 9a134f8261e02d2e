//! Refuses requests of those who may not ask: without the token, or from pages of other sites.

use std::sync::Arc;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use crate::access::Access;
use crate::problem::{Problem, ProblemKind};
use crate::state::{Shared, State};

/// What answers may load and do in a browser: only what this service sends. The map's worker and its pictures need `blob:`.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; worker-src 'self' blob:; style-src 'self'; \
     img-src 'self' data: blob:; connect-src 'self' blob:; form-action 'none'; base-uri 'none'; frame-ancestors 'none'";

/// Refuses requests without the token, and those that a page of another site makes in its visitor's browser.
pub(crate) async fn protect(
    axum::extract::State(state): Shared,
    request: Request,
    next: Next,
) -> Response {
    let mut response = match check(&state, request.uri(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers
        .entry(header::CACHE_CONTROL)
        .or_insert(HeaderValue::from_static("no-store"));
    response
}

fn check(state: &Arc<State>, uri: &Uri, headers: &HeaderMap) -> Result<(), Problem> {
    let host = host_of(uri, headers);
    if matches!(state.access, Access::ThisMachine) && !host.is_some_and(names_this_machine) {
        // Another site's name can be made to resolve to 127.0.0.1 (DNS rebinding).
        return Err(Problem::new(
            ProblemKind::Host,
            "the service answers on this machine only; expected the host 127.0.0.1, [::1] or localhost; for other hosts, also behind a \
             proxy, start it with --token-file or --no-token",
        ));
    }
    if let Some(origin) = headers.get(header::ORIGIN)
        && !is_same_origin(origin, host)
    {
        return Err(forbidden_origin());
    }
    if is_loaded_by_another_site(headers) {
        return Err(forbidden_origin());
    }
    // The page itself is public and asks for the token.
    let needs_token = uri.path().starts_with("/v1/") || uri.path() == "/metrics";
    match &state.access {
        Access::WithToken(token) if needs_token => {
            let given = headers
                .get(header::AUTHORIZATION)
                .and_then(|value| value.to_str().ok())
                .and_then(|value| value.split_once(' '))
                .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
                .map(|(_, given)| given.trim());
            match given {
                Some(given) if token.is(given) => Ok(()),
                _ => Err(Problem::new(
                    ProblemKind::Token,
                    "expected the header `Authorization: Bearer TOKEN` with the token of this service",
                )
                .with_header(header::WWW_AUTHENTICATE, "Bearer realm=\"grimnet\"")),
            }
        }
        _ => Ok(()),
    }
}

/// The host that a request names: that of an absolute address, else that of the header (RFC 9112, 3.2.2).
pub(crate) fn host_of<'a>(uri: &'a Uri, headers: &'a HeaderMap) -> Option<&'a str> {
    uri.authority()
        .map(|authority| authority.as_str())
        .or_else(|| {
            headers
                .get(header::HOST)
                .and_then(|value| value.to_str().ok())
        })
}

/// Whether a host with or without a port is this machine.
fn names_this_machine(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(v6) => v6.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost")
        || name
            .parse::<std::net::IpAddr>()
            .is_ok_and(|address| address.is_loopback())
}

/// Whether a page that this service sent makes the request.
fn is_same_origin(origin: &HeaderValue, host: Option<&str>) -> bool {
    let origin = origin.to_str().unwrap_or_default();
    let of_origin = origin
        .strip_prefix("http://")
        .or_else(|| origin.strip_prefix("https://"));
    of_origin.is_some() && of_origin == host
}

/// Whether a page of another site loads what is asked for, such as a tile as a picture: browsers send no `Origin` with that, but say so in
/// `Sec-Fetch-Site` (W3C Fetch Metadata Request Headers). A link that leads to a page of this service is followed.
fn is_loaded_by_another_site(headers: &HeaderMap) -> bool {
    let is = |name: &str, one_of: &[&str]| {
        let value = headers.get(name).and_then(|value| value.to_str().ok());
        value.is_some_and(|value| one_of.contains(&value))
    };
    is("sec-fetch-site", &["cross-site", "same-site"]) && !is("sec-fetch-mode", &["navigate"])
}

fn forbidden_origin() -> Problem {
    Problem::new(
        ProblemKind::Origin,
        "the request comes from a page of another site; expected one from this service, or no browser",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_machine() {
        for host in [
            "localhost",
            "LOCALHOST:8080",
            "127.0.0.1:1",
            "127.1.2.3",
            "[::1]:80",
            "[::1]",
        ] {
            assert!(names_this_machine(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "127.0.0.1.evil.example",
            "localhost.evil.example:80",
            "10.0.0.1",
            "[::2]",
        ] {
            assert!(!names_this_machine(host), "{host}");
        }
    }

    #[test]
    fn only_this_services_pages() {
        let host = Some("127.0.0.1:8080");
        let same = |origin: &'static str| is_same_origin(&HeaderValue::from_static(origin), host);
        assert!(same("http://127.0.0.1:8080"));
        for other in [
            "http://127.0.0.1:8081",
            "http://evil.example",
            "null",
            "",
            "file://",
        ] {
            assert!(!same(other), "{other}");
        }
        assert!(!is_same_origin(&HeaderValue::from_static(""), None));
    }

    #[test]
    fn pictures_on_pages_of_other_sites_are_told_from_links() {
        let by_another = |site: &'static str, mode: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert("sec-fetch-site", HeaderValue::from_static(site));
            headers.insert("sec-fetch-mode", HeaderValue::from_static(mode));
            is_loaded_by_another_site(&headers)
        };
        assert!(by_another("cross-site", "no-cors") && by_another("same-site", "no-cors"));
        assert!(!by_another("cross-site", "navigate"));
        assert!(!by_another("same-origin", "cors") && !by_another("none", "navigate"));
        assert!(!is_loaded_by_another_site(&HeaderMap::new()));
    }
}
