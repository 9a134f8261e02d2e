//! Hostile clients: tracks that nobody uses, slowness.

use crate::client::{FORM, send};
use crate::kind::Outcome::{Closed, Left, Status};
use crate::kind::{Act, BUSY, Kind, ask, ask_each, kind};
use crate::request::Requests;

pub fn tracks(requests: &Requests) -> Vec<Kind> {
    let json = "content-type: application/json";
    let begun = send(requests.address, "POST /v1/tracks", &[], &[]);
    let track = format!("/v1/tracks/{}", begun.json()["id"]);
    let begin = |body: &[u8]| requests.with_body("POST /v1/tracks", &[json], body);
    let nonsense: Vec<Vec<u8>> = vec![
        begin(b"[]x"),
        begin(b"{\"map\": \"../../etc\"}"),
        begin(&b"{\"map\":".repeat(2_000)),
        begin(&vec![b' '; 100_000]),
        requests.with_body(
            "POST /v1/tracks/999999/frames?time_s=nan",
            &["content-type: image/jpeg"],
            b"x",
        ),
        requests.with_body(
            &format!("POST {track}/frames?time_s=1e300"),
            &["content-type: image/jpeg"],
            b"x",
        ),
        requests.head(&format!("GET {track}/events"), &["last-event-id: -1e9"]),
        requests.head("DELETE /v1/tracks/999999", &[]),
    ];
    vec![
        // There are 64 at most.
        kind(
            "tracks that nobody uses",
            ask(begin(b"{}")),
            &[Status(201), BUSY],
        ),
        kind(
            "requests about tracks that are none",
            ask_each(nonsense),
            &[Status(400), Status(404), Status(413), BUSY],
        ),
        kind(
            "a client that follows a track and goes away",
            Act::Leave(requests.head(&format!("GET {track}/events"), &["last-event-id: 9"])),
            &[Left],
        ),
    ]
}

pub fn slowness(requests: &Requests) -> Vec<Kind> {
    let begun = format!("GET /healthz HTTP/1.1\r\nhost: {}\r\n", requests.address).into_bytes();
    let body = [
        requests.head(
            "POST /v1/locate",
            &["content-type: image/jpeg", "content-length: 1000"],
        ),
        b"abc".to_vec(),
    ]
    .concat();
    let part = [
        requests.head("POST /v1/locate", &[FORM, "content-length: 1000"]),
        b"--XyZ\r\ncontent-disposition: form-data; name=\"photo\"\r\n\r\nabc".to_vec(),
    ]
    .concat();
    let open = format!(
        "GET /web/maplibre-gl.mjs HTTP/1.1\r\nhost: {}\r\n\r\n",
        requests.address
    );
    let expecting = requests.head(
        "POST /v1/locate",
        &[
            "content-type: image/jpeg",
            "content-length: 9",
            "expect: 100-continue",
        ],
    );
    vec![
        kind(
            "clients that say nothing",
            Act::Crowd,
            &[Closed, Status(408)],
        ),
        kind(
            "a head that stops",
            Act::Stall(begun.clone()),
            &[Closed, Status(408)],
        ),
        kind(
            "a head that trickles",
            Act::Trickle([begun, b"x: ".to_vec()].concat()),
            &[Closed, Status(408)],
        ),
        kind(
            "a body that stops",
            Act::Stall(body.clone()),
            &[Status(408), BUSY],
        ),
        kind(
            "a body that trickles",
            Act::Trickle(body),
            &[Status(408), Status(415), BUSY],
        ),
        kind("a form that stops", Act::Stall(part), &[Status(408), BUSY]),
        // The body is asked for, and does not come.
        kind(
            "a client that waits to be asked",
            Act::Stall(expecting),
            &[Status(100), BUSY],
        ),
        kind(
            "a client that takes no answers",
            Act::Deaf(open.clone().into_bytes()),
            &[Closed],
        ),
        kind(
            "a client that goes away before its answer",
            Act::Leave(open.into_bytes()),
            &[Left],
        ),
    ]
}
