//! Hostile addresses and heads.

use crate::kind::Outcome::{Closed, Status};
use crate::kind::{Act, BUSY, Kind, ask, ask_each, kind};
use crate::request::Requests;

pub fn targets(requests: &Requests) -> Vec<Kind> {
    let get = |path: &str| requests.head(&format!("GET {path}"), &[]);
    let paths: Vec<Vec<u8>> = [
        "/../../../../etc/passwd",
        "/web/..%2f..%2f..%2fetc%2fpasswd",
        "/web/%2e%2e/%2e%2e/Cargo.toml",
        "/web//etc/passwd",
        "/web/api.js%00.html",
        "/v1/maps/..%2f..%2fetc/tilejson.json",
        "/v1/maps/%2e%2e/tiles/0/0/0",
        "/v1/maps/area/tiles/99999999999/-1/1e3",
        "/v1/maps/area/tiles/24/16777216/16777216",
        "/v1/tracks/18446744073709551616",
        "/v1/tracks/-1/session",
        "/v1/tracks/..;/events",
        "/.git/config",
        "/cgi-bin/%25%32%65%25%32%65/",
        "/%ff%fe%fd",
    ]
    .iter()
    .map(|path| get(path))
    .collect();
    let many = "a=b&".repeat(10_000);
    let queries: Vec<Vec<u8>> = [
        "path=/etc/passwd",
        "hfov_deg=1&hfov_deg=2",
        "detail=maybe",
        "hfov_deg=700",
        "near=nan,inf,1e999",
        "gsd_m=-1",
        "heading=%00",
        "name=%ff%fe&x=%zz%%%",
        &many,
    ]
    .iter()
    .map(|query| {
        let line = format!("POST /v1/locate?{query}");
        requests.with_body(&line, &["content-type: image/jpeg"], b"\xff\xd8\xff")
    })
    .collect();
    let address = requests.address;
    vec![
        // Some are no addresses at all.
        kind(
            "paths out of the service",
            ask_each(paths),
            &[Status(404), Status(400)],
        ),
        kind(
            "queries that are none",
            ask_each(queries),
            &[Status(400), Status(422), BUSY],
        ),
        kind(
            "an address of 100 kB",
            ask(get(&format!("/{}", "a".repeat(100_000)))),
            &[Status(414), Status(431)],
        ),
        kind(
            "tiles far from the map, each another one",
            Act::Ask(Box::new(move |number| {
                let (x, y) = (number * 48_271 % (1 << 24), number * 16_807 % (1 << 24));
                Requests { address }.head(&format!("GET /v1/maps/area/tiles/24/{x}/{y}"), &[])
            })),
            // Without a map of this name there is none.
            &[Status(200), Status(404)],
        ),
    ]
}

pub fn heads(requests: &Requests) -> Vec<Kind> {
    let host = requests.address;
    let bytes = |text: &str| text.as_bytes().to_vec();
    let noise: Vec<Vec<u8>> = vec![
        b"\0\xff\xfe\r\n\r\n".to_vec(),
        // The beginning of a connection with TLS.
        b"\x16\x03\x01\x02\0\x01\0\x01\xfc\x03\x03\r\n\r\n".to_vec(),
        bytes("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"),
        bytes("GET / HTTP/9.9\r\n\r\n"),
        bytes("GET /\r\n\r\n"),
        bytes("GET / HTTP/1.1\r\n: no name\r\n\r\n"),
        bytes("GET / HTTP/1.1\r\nhost : a\r\n\r\n"),
        bytes("GET / HTTP/1.1\r\nhost: a\rb\r\n\r\n"),
    ];
    let others: Vec<Vec<u8>> = vec![
        bytes("GET / HTTP/1.0\r\n\r\n"),
        bytes("GET / HTTP/1.1\r\nhost: evil.example\r\nconnection: close\r\n\r\n"),
        bytes(
            "GET http://evil.example/ HTTP/1.1\r\nhost: evil.example\r\nconnection: close\r\n\r\n",
        ),
        requests.head("POST /v1/locate", &["origin: http://evil.example"]),
        requests.head("GET /v1/maps", &["origin: null"]),
    ];
    let methods = ["BREW", "TRACE", "PUT", "PATCH", "CONNECT", "OPTIONS"]
        .iter()
        .map(|method| requests.head(&format!("{method} /v1/locate"), &[]))
        .collect();
    vec![
        kind(
            "noise for a head",
            ask_each(noise),
            &[Status(400), Closed, Status(421)],
        ),
        kind(
            "other hosts and sites",
            ask_each(others),
            &[Status(403), Status(421)],
        ),
        kind(
            "other methods",
            ask_each(methods),
            &[Status(405), Status(404)],
        ),
        kind(
            "500 headers",
            ask(bytes(&format!(
                "GET / HTTP/1.1\r\nhost: {host}\r\n{}\r\n",
                "x: y\r\n".repeat(500)
            ))),
            &[Status(431)],
        ),
        kind(
            "a header of a megabyte",
            ask(requests.head("GET /", &[&format!("x: {}", "y".repeat(1 << 20))])),
            // A reset may take the place of the answer.
            &[Status(431), Closed],
        ),
        kind(
            "an upgrade to other protocols",
            ask(requests.head(
                "GET /v1/nothing",
                &[
                    "upgrade: h2c, websocket",
                    "http2-settings: AAMAAABkAAQAAP__",
                ],
            )),
            &[Status(404)],
        ),
    ]
}
