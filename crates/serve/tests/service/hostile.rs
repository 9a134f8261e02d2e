//! Requests that want to harm: none may crash the service, fill its memory or keep others out.

use std::io::{Cursor, Write as _};
use std::time::Duration;

use grimnet_serve::{Limits, PhotoLimits};
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
    // A body that stops.
    let head = format!(
        "POST /v1/locate HTTP/1.1\r\nhost: {}\r\n{PHOTO}\r\ncontent-length: 1000\r\n\r\nabc",
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
    assert_eq!(get(running.address, "/healthz").status, 200);
}

#[test]
fn a_full_queue_refuses_and_recovers() {
    let limits = Limits {
        at_once: 1,
        queue: 1,
        body_pause: Duration::from_secs(60),
        ..strict()
    };
    let limits = Limits {
        body_time: Duration::from_secs(60),
        ..limits
    };
    let running = Running::on_area(limits);
    let head = format!(
        "POST /v1/locate HTTP/1.1\r\nhost: {}\r\nconnection: close\r\n{PHOTO}\r\ncontent-length: {}\r\n\r\n",
        running.address,
        area().photo.len()
    );
    let mut open: Vec<_> = (0..2).map(|_| connect(running.address)).collect();
    for stream in &mut open {
        stream.write_all(head.as_bytes()).unwrap();
    }
    while !get(running.address, "/metrics")
        .text()
        .contains("grimnet_localisations_waiting 2")
    {}
    let refused = send(running.address, "POST /v1/locate", &[PHOTO], &area().photo);
    refused.problem(503, "busy");
    let after: u64 = refused.header("retry-after").unwrap().parse().unwrap();
    assert!((1..=60).contains(&after));
    // Those that hold a place are answered, and then others are.
    for stream in &mut open {
        stream.write_all(&area().photo).unwrap();
    }
    for mut stream in open {
        assert_eq!(Answer::of(&read_all(&mut stream)).json()["state"], "fix");
    }
    let next = send(running.address, "POST /v1/locate", &[PHOTO], &area().photo);
    assert_eq!(next.json()["state"], "fix");
}

#[test]
fn clients_that_go_away_give_their_place_back() {
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
    while !get(running.address, "/metrics")
        .text()
        .contains("grimnet_localisations_waiting 0")
    {}
    let answer = send(running.address, "POST /v1/locate", &[PHOTO], &area().photo);
    assert_eq!(answer.json()["state"], "fix");
}

#[test]
fn malformed_photos_and_forms_are_told_apart() {
    let post = |headers: &[&str], body: &[u8]| send(shared(), "POST /v1/locate", headers, body);
    post(&[PHOTO], b"not a picture").problem(415, "unsupported-media-type");
    post(&[PHOTO], &area().photo[..area().photo.len() / 2]).problem(422, "bad-value");
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
    for query in ["hfov_deg=700", "heading=north", "near=1,2", "gsd_m=-1"] {
        let line = format!("POST /v1/locate?{query}");
        send(shared(), &line, &[PHOTO], photo).problem(422, "bad-value");
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
        "/web/",
        "/.git/config",
    ] {
        let answer = get(shared(), path);
        answer.problem(404, "not-found");
    }
    send(shared(), "DELETE /v1/maps", &[], &[]).problem(405, "method-not-allowed");
    send(shared(), "GET /v1/locate", &[], &[]).problem(405, "method-not-allowed");
}

/// Many of every kind, one after the other and at once: the service lives, and its memory is bounded.
#[test]
fn thousands_of_hostile_requests() {
    const THREADS: usize = 4;
    const EACH: usize = 500;
    let running = Running::on_area(strict());
    let address = running.address;
    let bomb = png(&RgbImage::new(2000, 2000).into());
    let deep = png(&DynamicImage::new_rgba16(900, 900));
    let half = &area().photo[..area().photo.len() / 2];
    let head = |length: usize| {
        format!("POST /v1/locate HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\ncontent-type: image/png\r\ncontent-length: {length}\r\n\r\n").into_bytes()
    };
    let with = |body: &[u8]| [head(body.len()), body.to_vec()].concat();
    let requests: Vec<Vec<u8>> = vec![
        with(&bomb),
        with(&deep),
        with(half),
        with(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"),
        head(usize::MAX),
        b"\0\xff\xfe\r\n\r\n".to_vec(),
        b"GET / HTTP/9.9\r\n\r\n".to_vec(),
        format!("GET /{} HTTP/1.1\r\nhost: {address}\r\n\r\n", "a".repeat(100_000)).into_bytes(),
        format!("GET / HTTP/1.1\r\nhost: {address}\r\n{}\r\n", "x: y\r\n".repeat(500)).into_bytes(),
        format!("GET /web/..%2f..%2fetc%2fpasswd HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n").into_bytes(),
        format!("POST /v1/locate HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n{FORM}\r\ncontent-length: 9\r\n\r\n--XyZ\r\n\r\n").into_bytes(),
        format!("POST /v1/locate HTTP/1.1\r\nhost: {address}\r\ntransfer-encoding: chunked\r\n{PHOTO}\r\n\r\nffffffffffffffff\r\n").into_bytes(),
    ];
    std::thread::scope(|scope| {
        for thread in 0..THREADS {
            let requests = &requests;
            scope.spawn(move || {
                for number in 0..EACH {
                    let bytes = &requests[(number + thread) % requests.len()];
                    let mut stream = connect(address);
                    let _ = stream.write_all(bytes);
                    // Half of them do not wait for the answer.
                    if number % 2 == 0 {
                        let _ = stream.shutdown(std::net::Shutdown::Write);
                        let answer = read_all(&mut stream);
                        let status = String::from_utf8_lossy(&answer[..answer.len().min(12)]);
                        assert!(!status.starts_with("HTTP/1.1 2"), "{status}");
                        assert!(!status.starts_with("HTTP/1.1 500"), "{status}");
                    }
                }
            });
        }
    });
    assert_eq!(get(address, "/healthz").status, 200);
    // All tests of this file in one process, with the model and the pack.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak_kib = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|line| {
            line.trim()
                .trim_end_matches("kB")
                .trim()
                .parse::<u64>()
                .ok()
        });
    assert!(peak_kib.is_none_or(|kib| kib < 3 << 20), "{peak_kib:?} KiB");
    let next = send(address, "POST /v1/locate", &[PHOTO], &area().photo);
    assert_eq!(next.json()["state"], "fix");
}
