//! The pages: files that are part of the program.

use std::io::Write as _;
use std::sync::LazyLock;

use axum::Router;
use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use flate2::{Compression, write::GzEncoder};

/// A file of a page.
struct Asset {
    /// Where it is served.
    path: &'static str,
    media_type: &'static str,
    content: &'static [u8],
    /// The content as gzip, and the entity tags of both; made at the first request.
    ready: LazyLock<Ready, Box<dyn FnOnce() -> Ready + Send>>,
}

struct Ready {
    gzip: Bytes,
    tag: HeaderValue,
    gzip_tag: HeaderValue,
}

impl Asset {
    fn new(path: &'static str, media_type: &'static str, content: &'static [u8]) -> Self {
        Self {
            path,
            media_type,
            content,
            ready: LazyLock::new(Box::new(|| Ready::of(content))),
        }
    }

    fn response(&self, headers: &HeaderMap) -> Response {
        let takes_gzip = headers
            .get(header::ACCEPT_ENCODING)
            .and_then(|value| value.to_str().ok())
            .is_some_and(|value| value.split(',').any(takes_gzip));
        let ready = &*self.ready;
        let (tag, body) = if takes_gzip {
            (&ready.gzip_tag, ready.gzip.clone())
        } else {
            (&ready.tag, Bytes::from_static(self.content))
        };
        let known = headers.get(header::IF_NONE_MATCH) == Some(tag);
        let mut response = if known {
            StatusCode::NOT_MODIFIED.into_response()
        } else {
            body.into_response()
        };
        let headers = response.headers_mut();
        headers.insert(header::ETAG, tag.clone());
        headers.insert(
            header::CONTENT_TYPE,
            HeaderValue::from_static(self.media_type),
        );
        headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
        // Asked again each time, and answered with 304: a new program brings a new page.
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        if takes_gzip && !known {
            headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        }
        response
    }
}

impl Ready {
    fn of(content: &[u8]) -> Self {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        // Writing into memory does not fail.
        let _ = encoder.write_all(content);
        let hash = blake3::hash(content).to_hex();
        let tag =
            |text: String| HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static("\"\""));
        Self {
            gzip: encoder.finish().unwrap_or_default().into(),
            tag: tag(format!("\"{}\"", &hash[..32])),
            gzip_tag: tag(format!("\"{}-gzip\"", &hash[..32])),
        }
    }
}

/// Whether one element of `Accept-Encoding` takes gzip.
fn takes_gzip(element: &str) -> bool {
    let mut parts = element.split(';').map(str::trim);
    let is_gzip = parts
        .next()
        .is_some_and(|name| name.eq_ignore_ascii_case("gzip") || name == "*");
    is_gzip && !parts.any(|part| matches!(part, "q=0" | "q=0.0" | "q=0.00" | "q=0.000"))
}

static ASSETS: LazyLock<Vec<Asset>> = LazyLock::new(|| {
    const HTML: &str = "text/html; charset=utf-8";
    const SCRIPT: &str = "text/javascript; charset=utf-8";
    const STYLE: &str = "text/css; charset=utf-8";
    vec![
        Asset::new("/", HTML, include_bytes!("../web/page.html")),
        Asset::new("/web/page.css", STYLE, include_bytes!("../web/page.css")),
        Asset::new("/web/page.js", SCRIPT, include_bytes!("../web/page.js")),
        Asset::new(
            "/web/service.js",
            SCRIPT,
            include_bytes!("../web/service.js"),
        ),
        Asset::new("/web/tracks.js", SCRIPT, include_bytes!("../web/tracks.js")),
        Asset::new(
            "/web/track_shapes.js",
            SCRIPT,
            include_bytes!("../web/track_shapes.js"),
        ),
        Asset::new(
            "/web/map_view.js",
            SCRIPT,
            include_bytes!("../web/map_view.js"),
        ),
        Asset::new(
            "/web/maplibre-gl.mjs",
            SCRIPT,
            include_bytes!("../web/vendor/maplibre-gl.mjs"),
        ),
        Asset::new(
            "/web/maplibre-gl-worker.mjs",
            SCRIPT,
            include_bytes!("../web/vendor/maplibre-gl-worker.mjs"),
        ),
        Asset::new(
            "/web/maplibre-gl.css",
            STYLE,
            include_bytes!("../web/vendor/maplibre-gl.css"),
        ),
        Asset::new(
            "/web/maplibre-gl-licence.txt",
            "text/plain; charset=utf-8",
            include_bytes!("../web/vendor/LICENSE.txt"),
        ),
        Asset::new("/api", HTML, include_bytes!("../web/api.html")),
        Asset::new("/web/api.js", SCRIPT, include_bytes!("../web/api.js")),
        Asset::new("/web/style.css", STYLE, include_bytes!("../web/style.css")),
    ]
});

/// Serves the files, and nothing else: requests choose among fixed addresses.
pub(crate) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    ASSETS.iter().fold(Router::new(), |router, asset| {
        router.route(
            asset.path,
            get(move |headers: HeaderMap| async move { asset.response(&headers) }),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_are_understood() {
        for yes in ["gzip", " GZIP;q=0.5", "*"] {
            assert!(takes_gzip(yes), "{yes}");
        }
        for no in ["", "br", "gzip;q=0", "gzip; q=0.0", "xgzip"] {
            assert!(!takes_gzip(no), "{no}");
        }
    }
}
