//! The pages: files that are part of the program.

use std::io::Write as _;
use std::sync::LazyLock;

use axum::Router;
use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use flate2::{Compression, write::GzEncoder};

use crate::entity_tag::is_known;
use crate::weighted_list::weighted_list;

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
        let takes_gzip = takes_gzip(headers);
        let ready = &*self.ready;
        let (tag, body) = if takes_gzip {
            (&ready.gzip_tag, ready.gzip.clone())
        } else {
            (&ready.tag, Bytes::from_static(self.content))
        };
        let known = is_known(headers, tag);
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

/// Whether `Accept-Encoding` takes gzip: `*` stands for what is not named.
fn takes_gzip(headers: &HeaderMap) -> bool {
    let encodings = weighted_list(headers, header::ACCEPT_ENCODING);
    let weight_of = |name: &str| encodings.iter().find(|(each, _)| each == name);
    let found = weight_of("gzip").or_else(|| weight_of("*"));
    found.is_some_and(|(_, weight)| *weight > 0.0)
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
        let takes = |text: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::ACCEPT_ENCODING, HeaderValue::from_static(text));
            takes_gzip(&headers)
        };
        for yes in ["gzip", " GZIP;q=0.5", "*", "br, *;q=0.1", "*;q=0, gzip"] {
            assert!(takes(yes), "{yes}");
        }
        for no in ["", "br", "gzip;q=0", "gzip; q=0.0", "xgzip", "gzip;q=0, *"] {
            assert!(!takes(no), "{no}");
        }
        assert!(!takes_gzip(&HeaderMap::new()));
    }
}
