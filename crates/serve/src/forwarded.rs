//! What a proxy in front of the service says of the client's connection.

use axum::http::{HeaderMap, header};

/// The scheme that the client used: `https` if a proxy with TLS says so, in `Forwarded` (RFC 7239) or `X-Forwarded-Proto`, else `http`.
///
/// Addresses in answers are made of it, and nothing else: whoever sends the header reads the answer.
pub(crate) fn scheme_of(headers: &HeaderMap) -> &'static str {
    let text = |name: &str| headers.get(name).and_then(|value| value.to_str().ok());
    // The first element is that of the proxy nearest to the client.
    let first = |text: &str| text.split(',').next().unwrap_or_default().trim().to_owned();
    let standard = text(header::FORWARDED.as_str())
        .map(first)
        .and_then(|element| {
            element.split(';').find_map(|pair| {
                let (name, value) = pair.split_once('=')?;
                let is_proto = name.trim().eq_ignore_ascii_case("proto");
                is_proto.then(|| value.trim().trim_matches('"').to_owned())
            })
        });
    let said = standard.or_else(|| text("x-forwarded-proto").map(first));
    match said {
        Some(scheme) if scheme.eq_ignore_ascii_case("https") => "https",
        _ => "http",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scheme(name: &'static str, value: &'static str) -> &'static str {
        let mut headers = HeaderMap::new();
        headers.insert(name, axum::http::HeaderValue::from_static(value));
        scheme_of(&headers)
    }

    #[test]
    fn https_is_what_a_proxy_says() {
        assert_eq!(scheme_of(&HeaderMap::new()), "http");
        for (name, value) in [
            ("x-forwarded-proto", "https"),
            ("x-forwarded-proto", "HTTPS, http"),
            ("forwarded", "for=192.0.2.60;proto=https;by=203.0.113.43"),
            (
                "forwarded",
                "For=\"[2001:db8::1]\"; Proto=\"https\", for=10.0.0.1;proto=http",
            ),
        ] {
            assert_eq!(scheme(name, value), "https", "{name}: {value}");
        }
        for (name, value) in [
            ("x-forwarded-proto", "http, https"),
            ("x-forwarded-proto", "javascript"),
            ("forwarded", "for=192.0.2.60"),
            ("forwarded", "proto"),
            ("host", "https"),
        ] {
            assert_eq!(scheme(name, value), "http", "{name}: {value}");
        }
    }
}
