//! Requests that want to harm: none may crash the service, fill its memory or keep others out.

use std::io::{Cursor, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use grimnet_serve::{Access, Limits, PhotoLimits, Token};
use image::{DynamicImage, ImageFormat, RgbImage};

use crate::area::{Running, area, shared};
use crate::client::{Answer, FORM, connect, form, get, read_all, send, send_raw};

const PHOTO: &str = "content-type: image/jpeg";

/// Little patience, little memory.
fn strict() -> Limits {
    Limits {
        max_body_bytes: 1 << 20,
        photo: PhotoLimits::of_memory(4_000_000),
        body_pause: Duration::from_millis(300),
        body_time: Duration::from_millis(1500),
        head_time: Duration::from_millis(300),
        write_pause: Duration::from_millis(300),
        ..Limits::default()
    }
}

fn png(image: &DynamicImage) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn oversized_bodies_are_refused_before_they_arrive() {
    let running = Running::on_area(strict());
    let declared = format!(
        "POST /v1/locate HTTP/1.1\r\nhost: {}\r\n{PHOTO}\r\ncontent-length: 999999999999\r\n\r\n",
        running.address
    );
    let answer = Answer::of(&send_raw(running.address, declared.as_bytes()));
    answer.problem(413, "too-large");
    // Without a declared length: in chunks, and in a form.
    let mut chunked = format!(
        "POST /v1/locate HTTP/1.1\r\nhost: {}\r\n{PHOTO}\r\ntransfer-encoding: chunked\r\n\r\n",
        running.address
    )
    .into_bytes();
    for _ in 0..20 {
        chunked.extend_from_slice(b"10000\r\n");
        chunked.extend(std::iter::repeat_n(0xFF, 0x10000));
        chunked.extend_from_slice(b"\r\n");
    }
    chunked.extend_from_slice(b"0\r\n\r\n");
    Answer::of(&send_raw(running.address, &chunked)).problem(413, "too-large");
    let body = form(&[("prior", None, &vec![b' '; 70_000])]);
    send(running.address, "POST /v1/locate", &[FORM], &body).problem(413, "too-large");
}

#[test]
fn decompression_bombs_are_refused_by_their_header() {
    let running = Running::on_area(strict());
    let post = |bytes: &[u8]| {
        let headers = ["content-type: application/octet-stream"];
        send(running.address, "POST /v1/locate", &headers, bytes)
    };
    // 4 million pixels of nothing in a few kilobytes.
    let many_pixels = png(&RgbImage::new(2000, 2000).into());
    assert!(many_pixels.len() < 100_000);
    let detail = post(&many_pixels).problem(413, "too-large");
    assert!(detail.contains("2000 x 2000"), "{detail}");
    // Few pixels of many bytes.
    let deep = DynamicImage::new_rgba16(900, 900);
    let detail = post(&png(&deep)).problem(413, "too-large");
    assert!(detail.contains("900 x 900"), "{detail}");
    // A JPEG that claims to be huge.
    let mut jpeg = area().photo.clone();
    let frame = jpeg.windows(2).rposition(|w| w == [0xFF, 0xC0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0xFF, 0xFF, 0xFF, 0xFF]);
    post(&jpeg).problem(413, "too-large");
}

#[test]
fn slow_clients_are_cut_off() {
    let running = Running::on_area(strict());
    // A head that never ends.
    let mut stream = connect(running.address);
    stream
        .write_all(b"GET /healthz HTTP/1.1\r\nhost: a\r\n")
        .unwrap();
    read_all(&mut stream);
    // A connection that says nothing.
    read_all(&mut connect(running.address));
    for route in ["/v1/locate", "/v1/answers", "/v1/tracks"] {
        // A body that stops.
        let head = format!(
            "POST {route} HTTP/1.1\r\nhost: {}\r\n{PHOTO}\r\ncontent-length: 1000\r\n\r\nabc",
            running.address
        );
        let mut stream = connect(running.address);
        stream.write_all(head.as_bytes()).unwrap();
        Answer::of(&read_all(&mut stream)).problem(408, "too-slow");
        // A body that trickles.
        let mut stream = connect(running.address);
        stream.write_all(head.as_bytes()).unwrap();
        let mut sending = stream.try_clone().unwrap();
        let trickle = std::thread::spawn(move || {
            while sending.write_all(b"x").is_ok() {
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        Answer::of(&read_all(&mut stream)).problem(408, "too-slow");
        trickle.join().unwrap();
    }
    assert_eq!(get(running.address, "/healthz").status, 200);
}

#[test]
fn bodies_that_do_not_come_keep_nobody_out() {
    let limits = Limits {
        at_once: 1,
        queue: 1,
        // Longer than any test: a body that were waited for would be waited for until the end.
        body_time: Duration::from_secs(3600),
        body_pause: Duration::from_secs(3600),
        ..Limits::default()
    };
    let running = Running::on_area(limits);
    let address = running.address;
    let track = send(address, "POST /v1/tracks", &[], &[]).json()["id"].to_string();
    let begun = |line: &str, headers: &str, length: usize| {
        let mut stream = connect(address);
        let head = format!(
            "{line} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n{headers}content-length: {length}\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).unwrap();
        stream
    };
    let photo_type = format!("{PHOTO}\r\n");
    let frames = |time_s: u32| format!("POST /v1/tracks/{track}/frames?time_s={time_s}");
    let mut open: Vec<_> = (0..10)
        .map(|_| begun("POST /v1/locate", &photo_type, area().photo.len()))
        .collect();
    let slow_frames: Vec<_> = (1..11)
        .map(|time_s| begun(&frames(time_s), &photo_type, 1000))
        .collect();
    let slow_lists: Vec<_> = (0..10)
        .map(|_| begun("POST /v1/answers", "", 1000))
        .collect();
    for expected in [
        "grimnet_localisations_waiting 20\n",
        "grimnet_conversions_waiting 10\n",
    ] {
        while !get(address, "/metrics").text().contains(expected) {}
    }
    for line in ["POST /v1/locate", &frames(0)] {
        let answer = send(address, line, &[PHOTO], &area().photo).json();
        let state = answer.get("state").unwrap_or(&answer["answer"]["state"]);
        assert_eq!(state, "fix", "{line}");
    }
    assert_eq!(send(address, "POST /v1/answers", &[], b"[]").status, 200);
    // A slow one is answered too, when it is there.
    let mut late = open.pop().unwrap();
    late.write_all(&area().photo).unwrap();
    assert_eq!(Answer::of(&read_all(&mut late)).json()["state"], "fix");
    drop((open, slow_frames, slow_lists));
}

/// A client whose body takes `bytes` of the memory for bodies, and lacks its last byte.
fn holder(address: SocketAddr, line: &str, headers: &str, bytes: usize) -> TcpStream {
    let mut stream = connect(address);
    let head = format!(
        "{line} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n{headers}content-length: {}\r\n\r\n",
        bytes + 1
    );
    stream.write_all(head.as_bytes()).unwrap();
    stream.write_all(&vec![b' '; bytes]).unwrap();
    stream
}

#[test]
fn bodies_together_take_bounded_memory() {
    let limits = Limits {
        at_once: 1,
        queue: 1,
        max_body_bytes: 1 << 20,
        ..Limits::default()
    };
    let running = Running::on_area(limits);
    let address = running.address;
    let photo_type = format!("{PHOTO}\r\n");
    let bytes = (1 << 20) - 1000;
    let mut open: Vec<_> = (0..2)
        .map(|_| holder(address, "POST /v1/locate", &photo_type, bytes))
        .collect();
    let expected = format!("grimnet_localisations_body_bytes {}\n", 2 * bytes);
    while !get(address, "/metrics").text().contains(&expected) {}
    let refused = send(address, "POST /v1/locate", &[PHOTO], &area().photo);
    let detail = refused.problem(503, "busy");
    assert!(detail.contains("memory"), "{detail}");
    let after: u64 = refused.header("retry-after").unwrap().parse().unwrap();
    assert!((1..=60).contains(&after));
    // All bytes of a form count, in its parts and before them.
    let with_photo = form(&[("photo", None, &area().photo)]);
    for body in [with_photo, vec![b' '; 100_000]] {
        let detail = send(address, "POST /v1/locate", &[FORM], &body).problem(503, "busy");
        assert!(detail.contains("memory"), "{detail}");
    }
    // Those that are there are answered, and then others are.
    for stream in &mut open {
        stream.write_all(b" ").unwrap();
        Answer::of(&read_all(stream)).problem(415, "unsupported-media-type");
    }
    let next = send(address, "POST /v1/locate", &[PHOTO], &area().photo);
    assert_eq!(next.json()["state"], "fix");
}

#[test]
fn the_answer_of_a_refused_request_is_found_after_its_body() {
    let limits = Limits {
        at_once: 1,
        queue: 0,
        max_body_bytes: 40 << 20,
        ..Limits::default()
    };
    let running = Running::on_area(limits);
    let head = |line: &str, more: &str| {
        format!(
            "{line} HTTP/1.1\r\nhost: {}\r\nconnection: close\r\n{PHOTO}\r\n{more}content-length: {}\r\n\r\n",
            running.address,
            20 << 20
        )
    };
    let bytes = 39 << 20;
    let photo_type = format!("{PHOTO}\r\n");
    let holder = holder(running.address, "POST /v1/locate", &photo_type, bytes);
    let expected = format!("grimnet_localisations_body_bytes {bytes}\n");
    while !get(running.address, "/metrics").text().contains(&expected) {}
    // More than sockets hold: a client that writes all of it before it reads finds the answer.
    let body = vec![0; 20 << 20];
    for (line, status, kind) in [
        ("POST /v1/locate", 503, "busy"),
        ("POST /v1/nothing", 404, "not-found"),
        ("POST /v1/answers", 413, "too-large"),
    ] {
        let mut stream = connect(running.address);
        stream.write_all(head(line, "").as_bytes()).unwrap();
        stream.write_all(&body).unwrap();
        Answer::of(&read_all(&mut stream)).problem(status, kind);
    }
    // A client that waits to be asked is answered at once.
    let mut stream = connect(running.address);
    let waits = head("POST /v1/answers", "expect: 100-continue\r\n");
    stream.write_all(waits.as_bytes()).unwrap();
    Answer::of(&read_all(&mut stream)).problem(413, "too-large");
    drop(holder);
}

#[test]
fn slow_bodies_of_refused_requests_keep_nobody_out() {
    let token = "correct-horse-battery-staple";
    let limits = Limits {
        at_once: 1,
        queue: 0,
        connections: 6,
        max_body_bytes: 100_000,
        // Longer than any test: whoever waits for such a body waits for ever.
        body_time: Duration::from_secs(3600),
        body_pause: Duration::from_secs(3600),
        ..Limits::default()
    };
    let access = Access::WithToken(Token::new(token).unwrap());
    let maps = vec![area().served("area", true)];
    let running = Running::start(access, maps, limits);
    let address = running.address;
    let right = format!("authorization: bearer {token}");
    let head = |line: &str, headers: &str| {
        format!("{line} HTTP/1.1\r\nhost: {address}\r\n{headers}\r\n\r\n{{")
    };
    // It takes all memory for the bodies of localisations, and one of the connections.
    let bytes = 100_000 - 1;
    let held = format!("{right}\r\n{PHOTO}\r\n");
    let holder = holder(address, "POST /v1/locate", &held, bytes);
    let expected = format!("grimnet_localisations_body_bytes {bytes}\n");
    let figures = || send(address, "GET /metrics", &[&right], &[]).text();
    while !figures().contains(&expected) {}
    let long = "content-length: 1000";
    let refused = [
        (401, "token", "POST /v1/locate", long.to_owned()),
        (
            404,
            "not-found",
            "POST /v1/nothing",
            format!("{right}\r\n{long}"),
        ),
        (
            405,
            "method-not-allowed",
            "POST /v1/maps",
            format!("{right}\r\n{long}"),
        ),
        (
            413,
            "too-large",
            "POST /v1/tracks",
            format!("{right}\r\ncontent-length: 100000"),
        ),
        (
            503,
            "busy",
            "POST /v1/locate",
            format!("{right}\r\n{PHOTO}\r\n{long}"),
        ),
    ];
    let slow: Vec<_> = refused
        .into_iter()
        .map(|(status, kind, line, headers)| {
            let mut stream = connect(address);
            stream.write_all(head(line, &headers).as_bytes()).unwrap();
            std::thread::spawn(move || {
                // Byte by byte, until the service has closed the connection. It reads nothing before.
                while stream.write_all(b"x").is_ok() {
                    std::thread::sleep(Duration::from_millis(20));
                }
                let answer = Answer::of(&read_all(&mut stream));
                answer.problem(status, kind);
                assert_eq!(answer.header("connection"), Some("close"));
            })
        })
        .collect();
    // All connections are taken: this one is answered when one of the slow clients has gone.
    assert_eq!(get(address, "/healthz").status, 200);
    for client in slow {
        client.join().unwrap();
    }
    drop(holder);
}

#[test]
fn lists_of_answers_have_places_of_their_own() {
    let limits = Limits {
        at_once: 1,
        queue: 1,
        ..Limits::default()
    };
    let running = Running::on_area(limits);
    let address = running.address;
    let bytes = (8 << 20) - 1;
    let mut open: Vec<_> = (0..2)
        .map(|_| holder(address, "POST /v1/answers", "", bytes))
        .collect();
    let expected = format!("grimnet_conversions_body_bytes {}\n", 2 * bytes);
    while !get(address, "/metrics").text().contains(&expected) {}
    let refused = send(address, "POST /v1/answers", &[], b"[{}]");
    refused.problem(503, "busy");
    let after: u64 = refused.header("retry-after").unwrap().parse().unwrap();
    assert!((1..=60).contains(&after));
    // Photos are localised all the same.
    let photo = send(address, "POST /v1/locate", &[PHOTO], &area().photo);
    assert_eq!(photo.json()["state"], "fix");
    for stream in &mut open {
        stream.write_all(b" ").unwrap();
        Answer::of(&read_all(stream)).problem(400, "bad-request");
    }
    assert_eq!(send(address, "POST /v1/answers", &[], b"[]").status, 200);
    let counted =
        "grimnet_requests_total{method=\"POST\",route=\"/v1/answers\",status=\"503\"} 1\n";
    let text = get(address, "/metrics").text();
    assert!(text.contains(counted), "{text}");
}

#[test]
fn clients_that_go_away_give_back_what_they_took() {
    let limits = Limits {
        at_once: 1,
        queue: 0,
        ..Limits::default()
    };
    let running = Running::on_area(limits);
    for _ in 0..5 {
        let mut stream = connect(running.address);
        let head = format!(
            "POST /v1/locate HTTP/1.1\r\nhost: {}\r\n{PHOTO}\r\ncontent-length: 100000\r\n\r\nabc",
            running.address
        );
        stream.write_all(head.as_bytes()).unwrap();
        drop(stream);
    }
    for expected in [
        "grimnet_localisations_waiting 0\n",
        "grimnet_localisations_body_bytes 0\n",
    ] {
        while !get(running.address, "/metrics").text().contains(expected) {}
    }
    // Each is counted: as one that left, or as one whose body breaks off.
    let figure = |name: &str| -> u64 {
        let text = get(running.address, "/metrics").text();
        let value = text.lines().find_map(|line| line.strip_prefix(name));
        value.map_or(0, |value| value.trim().parse().unwrap())
    };
    let broken = "grimnet_requests_total{method=\"POST\",route=\"/v1/locate\",status=\"400\"}";
    while figure("grimnet_requests_left_total") + figure(broken) < 5 {}
    let answer = send(running.address, "POST /v1/locate", &[PHOTO], &area().photo);
    assert_eq!(answer.json()["state"], "fix");
}

#[test]
fn malformed_photos_and_forms_are_told_apart() {
    let post = |headers: &[&str], body: &[u8]| send(shared(), "POST /v1/locate", headers, body);
    post(&[PHOTO], b"not a picture").problem(415, "unsupported-media-type");
    post(&[PHOTO], &area().photo[..area().photo.len() / 2]).problem(422, "bad-value");
    let detail = post(&[PHOTO], &area().damaged_photo()).problem(422, "bad-value");
    assert!(detail.contains("photo is damaged: "), "{detail}");
    post(&[PHOTO], &png(&RgbImage::new(4, 4).into())).problem(422, "bad-value");
    post(&[PHOTO], &[]).problem(400, "bad-request");
    post(&["content-type: application/json"], b"{}").problem(415, "unsupported-media-type");
    post(&["content-type: multipart/form-data"], b"x").problem(400, "bad-request");
    post(&[FORM], b"no form").problem(400, "bad-request");
    let photo: &[u8] = &area().photo;
    for parts in [
        vec![("file", None, photo)],
        vec![("photo", None, photo), ("photo", None, photo)],
        vec![("prior", None, &b"{}"[..])],
        vec![("prior", None, b"nonsense"), ("photo", None, photo)],
    ] {
        post(&[FORM], &form(&parts)).problem(400, "bad-request");
    }
    for query in [
        "hfov_deg=700",
        "heading=north",
        "near=1,2",
        "gsd_m=-1",
        "gsd_m=1e-300",
    ] {
        let line = format!("POST /v1/locate?{query}");
        send(shared(), &line, &[PHOTO], photo).problem(422, "bad-value");
    }
    // Beside a part `prior`: a name that is none is told, and a right one is one too many.
    let parts = form(&[("prior", None, b"{}"), ("photo", None, photo)]);
    for (query, expected) in [("hedding=5", "`hedding`"), ("heading=5", "in the query")] {
        let line = format!("POST /v1/locate?{query}");
        let refused = send(shared(), &line, &[FORM], &parts);
        let detail = refused.problem(400, "bad-request");
        assert!(detail.contains(expected), "{detail}");
    }
    for query in ["path=/etc/passwd", "hfov_deg=1&hfov_deg=2", "detail=maybe"] {
        let line = format!("POST /v1/locate?{query}");
        send(shared(), &line, &[PHOTO], photo).problem(400, "bad-request");
    }
}

#[test]
fn no_path_leads_out() {
    for path in [
        "/../../../../etc/passwd",
        "/web/../../../etc/passwd",
        "/web/..%2f..%2f..%2fetc%2fpasswd",
        "/web/%2e%2e/%2e%2e/Cargo.toml",
        "/web//etc/passwd",
        "/web/api.js%00.html",
        "/v1/maps/..%2f..%2fetc/tilejson.json",
        "/v1/maps/%FF/tilejson.json",
        "/v1/maps/area/tiles/19/%FF/0",
        "/v1/tracks/%FF",
        "/v1/tracks/%FF/events",
        "/v1/tracks/%FF/session",
        "/web/",
        "/.git/config",
    ] {
        let answer = get(shared(), path);
        answer.problem(404, "not-found");
    }
    send(shared(), "DELETE /v1/maps", &[], &[]).problem(405, "method-not-allowed");
    send(shared(), "GET /v1/locate", &[], &[]).problem(405, "method-not-allowed");
}

#[test]
fn open_requests_are_answered_after_the_service_is_stopped() {
    let mut running = Running::on_area(Limits::default());
    let address = running.address;
    let length = area().photo.len();
    let mut stream = connect(address);
    let head = format!(
        "POST /v1/locate HTTP/1.1\r\nhost: {address}\r\n{PHOTO}\r\ncontent-length: {length}\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).unwrap();
    while !get(address, "/metrics")
        .text()
        .contains("grimnet_localisations_waiting 1\n")
    {}
    running.stop.stop();
    // No connection is accepted any more.
    while TcpStream::connect(address).is_ok() {}
    stream.write_all(&area().photo).unwrap();
    assert_eq!(Answer::of(&read_all(&mut stream)).json()["state"], "fix");
    running.end();
}
