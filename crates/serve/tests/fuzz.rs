//! Requests put together at random, with the words of HTTP and right lengths: each gets an answer or a closed connection, never a status
//! of 500, and the service lives.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

#[path = "service/area.rs"]
#[allow(dead_code, reason = "other tests use the rest")]
mod area;
#[path = "service/client.rs"]
#[allow(dead_code, reason = "other tests use the rest")]
mod client;

use area::{area, shared};
use client::{get, send_raw};
use proptest::collection::vec;
use proptest::prelude::*;

/// Inputs of each test in a normal run.
const CASES: u32 = 48;

/// Sends a request, and reads what comes back.
fn check(bytes: &[u8]) {
    let answer = send_raw(shared(), bytes);
    let line = String::from_utf8_lossy(&answer[..answer.len().min(12)]).into_owned();
    assert!(line.is_empty() || line.starts_with("HTTP/1."), "{line}");
    assert!(!line.ends_with("500"), "{line}");
    assert_eq!(get(shared(), "/healthz").status, 200);
}

fn path() -> impl Strategy<Value = String> {
    let part = prop_oneof![
        Just("v1".to_owned()),
        Just("maps".to_owned()),
        Just("locate".to_owned()),
        Just("tracks".to_owned()),
        Just("frames".to_owned()),
        Just("events".to_owned()),
        Just("tiles".to_owned()),
        Just("web".to_owned()),
        Just("healthz".to_owned()),
        Just("..".to_owned()),
        Just("%2e%2e%2f".to_owned()),
        (any::<i64>()).prop_map(|number| number.to_string()),
        "[ -~]{0,12}",
    ];
    let query = prop_oneof![
        2 => Just(String::new()),
        1 => "\\?(heading|height_agl_m|near|format|map|time)=[-0-9a-zA-Z.,%&=]{0,24}",
    ];
    (vec(part, 0..6), query)
        .prop_map(|(parts, query)| format!("/{}{query}", parts.join("/").replace(' ', "%20")))
}

fn method() -> impl Strategy<Value = &'static str> {
    prop_oneof![
        Just("GET"),
        Just("POST"),
        Just("PUT"),
        Just("DELETE"),
        Just("HEAD"),
        Just("OPTIONS"),
        Just("get"),
    ]
}

fn header() -> impl Strategy<Value = String> {
    prop_oneof![
        Just("content-type: image/jpeg".to_owned()),
        Just("content-type: multipart/form-data; boundary=XyZ".to_owned()),
        Just("content-type: multipart/form-data".to_owned()),
        Just("content-type: application/json".to_owned()),
        Just("accept: application/gpx+xml".to_owned()),
        Just("accept: text/event-stream".to_owned()),
        Just("expect: 100-continue".to_owned()),
        Just("transfer-encoding: chunked".to_owned()),
        Just("last-event-id: -1".to_owned()),
        "[a-z-]{1,12}: [ -~]{0,40}",
    ]
}

/// A number as JSON has it, or what is none.
fn json_value() -> impl Strategy<Value = String> {
    prop_oneof![
        any::<f64>().prop_map(|v| v.to_string()),
        Just("NaN".to_owned()),
        Just("1e999".to_owned()),
        Just("null".to_owned()),
        Just("\"\"".to_owned()),
        Just("[[[[[[[[".to_owned()),
        Just("{}".to_owned()),
    ]
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn requests(
        method in method(),
        path in path(),
        headers in vec(header(), 0..5),
        body in vec(any::<u8>(), 0..300),
        length_error in prop_oneof![6 => Just(0i64), 1 => -3..3i64],
        noise in vec((0.0..1.0f64, any::<u8>()), 0..3),
    ) {
        let host = shared();
        let mut bytes = format!("{method} {path} HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\n").into_bytes();
        for header in headers {
            bytes.extend(header.bytes());
            bytes.extend(b"\r\n");
        }
        let length = (body.len() as i64 + length_error.min(0)).max(0);
        bytes.extend(format!("content-length: {length}\r\n\r\n").bytes());
        let head = bytes.len();
        bytes.extend(body);
        // A changed length would have the service wait for the rest.
        for (at, value) in noise {
            let at = head + (at * (bytes.len() - head) as f64) as usize;
            if let Some(byte) = bytes.get_mut(at) {
                *byte = value;
            }
        }
        check(&bytes);
    }

    #[test]
    fn forms_with_priors(
        fields in vec((prop_oneof![
            Just("heading"), Just("heading_deg"), Just("height_agl_m"), Just("hfov_deg"), Just("gsd_m"), Just("near"), Just("lat_deg"),
        ], json_value()), 0..6),
        with_photo in any::<bool>(),
        boundary in prop_oneof![4 => Just("XyZ"), 1 => Just("XyZ--"), 1 => Just("xyz")],
    ) {
        let prior: Vec<String> = fields.iter().map(|(name, value)| format!("\"{name}\": {value}")).collect();
        let prior = format!("{{{}}}", prior.join(", "));
        let mut body = format!("--{boundary}\r\ncontent-disposition: form-data; name=\"prior\"\r\n\r\n{prior}\r\n").into_bytes();
        if with_photo {
            body.extend(format!("--{boundary}\r\ncontent-disposition: form-data; name=\"photo\"; filename=\"a.jpg\"\r\n\r\n").bytes());
            // Its head alone: nothing is localised here.
            body.extend(&area().photo[..600]);
            body.extend(b"\r\n");
        }
        body.extend(format!("--{boundary}--\r\n").bytes());
        let host = shared();
        let mut bytes = format!(
            "POST /v1/locate HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\ncontent-type: multipart/form-data; boundary=XyZ\r\n\
             content-length: {}\r\n\r\n",
            body.len()
        )
        .into_bytes();
        bytes.extend(body);
        check(&bytes);
    }
}
