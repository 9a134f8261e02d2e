//! Frames of a flight in, its track out.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::SocketAddr;

use grimnet_serve::Limits;
use serde_json::Value;

use crate::area::{FLIGHT_STEP_S, Running, area, distance_m, shared};
use crate::client::{Answer, connect, get, send};

const PHOTO: &str = "content-type: image/jpeg";

fn begin(address: SocketAddr) -> String {
    let answer = send(address, "POST /v1/tracks", &[], &[]);
    assert_eq!(answer.status, 201, "{}", answer.text());
    let id = answer.json()["id"].to_string();
    assert_eq!(
        answer.header("location"),
        Some(&*format!("/v1/tracks/{id}"))
    );
    id
}

fn frame(address: SocketAddr, id: &str, time_s: f64) -> Answer {
    let line = format!("POST /v1/tracks/{id}/frames?time_s={time_s}");
    send(address, &line, &[PHOTO], &area().photo)
}

/// The track `id` of the shared service, as the list of tracks has it.
fn listed(id: &str) -> Value {
    let tracks = get(shared(), "/v1/tracks").json();
    let same = |track: &&Value| track["id"].as_u64() == id.parse().ok();
    let track = tracks["tracks"].as_array().unwrap().iter().find(same);
    track.unwrap().clone()
}

#[test]
fn frames_become_a_track() {
    let id = begin(shared());
    let mut frames = Vec::new();
    for (number, (photo, _)) in area().flight.iter().enumerate() {
        let time_s = number as f64 * FLIGHT_STEP_S;
        let line = format!("POST /v1/tracks/{id}/frames?time_s={time_s}");
        frames.push(send(shared(), &line, &[PHOTO], photo).json());
    }
    assert_eq!(frames[0]["number"], 1);
    assert_eq!(frames[0]["searched"], "whole_map");
    assert_eq!(frames[0]["answer"]["state"], "fix");
    let last = frames.last().unwrap();
    assert_eq!(last["number"], frames.len());
    assert_eq!(last["searched"], "window");
    assert_eq!(last["point"]["state"], "tracking", "{last}");
    let degrees = |name: &str| last["point"][name].as_f64().unwrap();
    let truth = area().flight.last().unwrap().1;
    let error_m = distance_m(truth, degrees("lat_deg"), degrees("lon_deg"));
    assert!(error_m < 3.0, "{error_m} m");

    let path = format!("/v1/tracks/{id}");
    let geojson = get(shared(), &path).json();
    let roles: Vec<&str> = geojson["features"]
        .as_array()
        .unwrap()
        .iter()
        .map(|feature| feature["properties"]["role"].as_str().unwrap())
        .collect();
    assert!(
        roles.contains(&"line") && roles.contains(&"position"),
        "{roles:?}"
    );
    let line = &geojson["features"][0]["geometry"];
    assert_eq!(line["type"], "MultiLineString", "{line}");
    let gpx = send(
        shared(),
        &format!("GET {path}"),
        &["accept: application/gpx+xml"],
        &[],
    );
    assert!(gpx.text().matches("<trkpt ").count() >= 2, "{}", gpx.text());
    let line = format!("GET {path}");
    let json = send(shared(), &line, &["accept: application/json"], &[]);
    assert_eq!(json.header("content-type"), Some("application/json"));
    assert_eq!(json.json(), geojson);
    send(shared(), &line, &["accept: text/csv"], &[]).problem(406, "not-acceptable");
}

#[test]
fn a_track_is_one_file_that_names_no_other_host() {
    let id = begin(shared());
    for (number, (photo, _)) in area().flight.iter().take(3).enumerate() {
        let name = "%3C/script%3E%3Cscript%3Ealert(1)%3C/script%3E";
        let line = format!("POST /v1/tracks/{id}/frames?time_s={number}&name={name}");
        assert_eq!(send(shared(), &line, &[PHOTO], photo).status, 200);
    }
    let answer = get(shared(), &format!("/v1/tracks/{id}/session"));
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(
        answer.header("content-type"),
        Some("text/html; charset=utf-8")
    );
    assert_eq!(
        answer.header("content-disposition"),
        Some(&*format!("attachment; filename=\"track-{id}.html\""))
    );
    let page = answer.text();
    assert!(page.len() < 4_000_000, "{} bytes", page.len());
    assert!(page.contains("default-src 'none'"));
    assert!(!page.contains("http://") && !page.contains("https://"));
    assert_eq!(page.matches("</script>").count(), 2);
    let (_, rest) = page.split_once("id=\"session\">").unwrap();
    let (json, _) = rest.split_once("</script>").unwrap();
    let session: Value = serde_json::from_str(json).unwrap();
    assert_eq!(session["title"], format!("Track {id} on area"));
    assert_eq!(session["frames"].as_array().unwrap().len(), 3);
    assert!(session["frames"][0]["answer"]["lat_deg"].is_f64());
    let tiles = session["tiles"].as_array().unwrap();
    assert!(tiles.len() > 1);
    for tile in tiles {
        let picture = tile["picture"].as_str().unwrap();
        assert!(picture.starts_with("data:image/"), "{picture:.40}");
    }
    get(shared(), "/v1/tracks/999999/session").problem(404, "not-found");
}

/// Numbers of the next `count` events on a stream.
fn numbers(stream: &mut impl std::io::BufRead, count: usize) -> Vec<u64> {
    let mut found = Vec::new();
    while found.len() < count {
        let mut line = String::new();
        assert!(stream.read_line(&mut line).unwrap() > 0, "the stream ended");
        if let Some(json) = line.strip_prefix("data:") {
            let frame: Value = serde_json::from_str(json.trim()).unwrap();
            found.push(frame["number"].as_u64().unwrap());
        }
    }
    found
}

fn follow(address: SocketAddr, id: &str, header: &str) -> BufReader<std::net::TcpStream> {
    let mut stream = connect(address);
    let head = format!("GET /v1/tracks/{id}/events HTTP/1.1\r\nhost: {address}\r\n{header}\r\n");
    stream.write_all(head.as_bytes()).unwrap();
    let mut reader = BufReader::new(stream);
    let mut status = String::new();
    reader.read_line(&mut status).unwrap();
    assert!(status.starts_with("HTTP/1.1 200"), "{status}");
    reader
}

#[test]
fn a_frame_that_is_sent_again_counts_once() {
    let id = begin(shared());
    let first = frame(shared(), &id, 7.5).json();
    assert_eq!(first["number"], 1);
    for _ in 0..5 {
        assert_eq!(frame(shared(), &id, 7.5).json(), first);
    }
    assert_eq!(listed(&id)["frames"], 1);
    assert_eq!(frame(shared(), &id, 8.5).json()["number"], 2);
}

#[test]
fn a_frame_has_no_point_while_nothing_is_known_and_when_it_is_too_old() {
    let id = begin(shared());
    let state = || listed(&id)["state"].clone();
    let mut grey = std::io::Cursor::new(Vec::new());
    image::GrayImage::from_pixel(640, 480, image::Luma([90]))
        .write_to(&mut grey, image::ImageFormat::Png)
        .unwrap();
    let line = format!("POST /v1/tracks/{id}/frames?time_s=99&heading=0&gsd_m=0.1");
    let nothing = send(
        shared(),
        &line,
        &["content-type: image/png"],
        grey.get_ref(),
    );
    assert_eq!(nothing.json()["answer"]["state"], "no_fix");
    assert_eq!(nothing.json()["point"], Value::Null);
    assert_eq!(state(), Value::Null);
    // The photo was not taken there.
    let line = format!("POST /v1/tracks/{id}/frames?time_s=100&near=1.0003,1.5003,1");
    let searching = send(shared(), &line, &[PHOTO], &area().photo).json();
    assert_eq!(searching["answer"]["state"], "no_fix");
    assert_eq!(searching["point"]["state"], "searching");
    assert_eq!(searching["point"].get("lat_deg"), None);
    assert_eq!(state(), "searching");
    let fix = frame(shared(), &id, 101.0).json();
    assert_eq!(fix["answer"]["state"], "fix");
    assert_eq!(state(), fix["point"]["state"]);
    // One that comes late does not change where the track is now.
    let late = frame(shared(), &id, 3.0).json();
    assert_eq!((&late["number"], &late["point"]), (&4.into(), &Value::Null));
    assert_eq!(state(), fix["point"]["state"]);
}

/// The latest time is then one of the clock before.
#[test]
fn the_state_of_a_track_is_that_since_its_clock_was_set() {
    let id = begin(shared());
    let before = frame(shared(), &id, 1000.0).json();
    assert_eq!(before["point"]["state"], "searching");
    let mut last = Value::Null;
    for second in 0..9 {
        last = frame(shared(), &id, f64::from(second)).json();
    }
    assert_eq!(last["point"]["state"], "tracking", "{last}");
    assert_eq!(listed(&id)["state"], "tracking");
}

#[test]
fn a_frame_that_is_refused_leaves_no_trace() {
    let id = begin(shared());
    for query in [
        "height_agl_m=30000",
        "hfov_deg=0.5",
        "gsd_m=1e-300",
        "near=1.5,1.0,-3",
    ] {
        let line = format!("POST /v1/tracks/{id}/frames?time_s=3&{query}");
        let refused = send(shared(), &line, &[PHOTO], &area().photo);
        refused.problem(422, "bad-value");
    }
    let line = format!("POST /v1/tracks/{id}/frames?time_s=3");
    send(shared(), &line, &[PHOTO], &area().damaged_photo()).problem(422, "bad-value");
    let right = frame(shared(), &id, 3.0).json();
    assert_eq!(right["number"], 1);
    assert_eq!(right["answer"]["state"], "fix");
}

#[test]
fn a_service_that_is_started_again_has_other_tracks() {
    let run = |tracks: usize| -> Vec<String> {
        let running = Running::on_area(Limits::default());
        (0..tracks).map(|_| begin(running.address)).collect()
    };
    let before = run(3);
    let after = run(1);
    assert!(!before.contains(&after[0]), "{before:?} {after:?}");
    // JavaScript has whole numbers up to 2^53.
    assert!(after[0].parse::<u64>().unwrap() < 1 << 53);
}

#[test]
fn an_ended_track_ends_its_events() {
    let id = begin(shared());
    frame(shared(), &id, 0.0);
    let mut stream = follow(shared(), &id, "connection: close\r\n");
    assert_eq!(numbers(&mut stream, 1), [1]);
    let line = format!("DELETE /v1/tracks/{id}");
    assert_eq!(send(shared(), &line, &[], &[]).status, 204);
    let mut line = String::new();
    while stream.read_line(&mut line).unwrap() > 0 {
        assert!(!line.starts_with(':'), "it is kept alive");
        line.clear();
    }
}

#[test]
fn proxies_are_asked_to_pass_events_on_as_they_come() {
    let id = begin(shared());
    let mut stream = follow(shared(), &id, "");
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        assert!(stream.read_line(&mut head).unwrap() > 0, "{head}");
    }
    assert!(head.contains("x-accel-buffering: no\r\n"), "{head}");
}

#[test]
fn events_come_live_and_resume() {
    let mut running = Running::on_area(Limits::default());
    let address = running.address;
    let id = begin(address);
    frame(address, &id, 0.0);
    let mut stream = follow(address, &id, "");
    assert_eq!(numbers(&mut stream, 1), [1]);
    frame(address, &id, 1.0);
    assert_eq!(numbers(&mut stream, 1), [2]);
    frame(address, &id, 2.0);
    let mut resumed = follow(address, &id, "last-event-id: 1\r\n");
    assert_eq!(numbers(&mut resumed, 2), [2, 3]);
    let line = format!("GET /v1/tracks/{id}/events");
    send(address, &line, &["last-event-id: x"], &[]).problem(400, "bad-request");
    let last = format!("last-event-id: {}\r\n", u64::MAX);
    let mut nothing = follow(address, &id, &last);
    // Streams end when the service does, which waits for them no longer.
    running.end();
    let mut rest = String::new();
    while stream.read_line(&mut rest).unwrap_or(0) > 0 {}
    let mut rest = String::new();
    while nothing.read_line(&mut rest).unwrap_or(0) > 0 {}
    let has_event = rest.lines().any(|line| line.starts_with("data:"));
    assert!(!has_event, "{rest}");
}

#[test]
fn tracks_that_do_not_exist_and_frames_without_time() {
    let id = begin(shared());
    let empty = get(shared(), &format!("/v1/tracks/{id}"));
    assert_eq!(
        empty.json(),
        serde_json::json!({"type": "FeatureCollection", "features": []})
    );
    for path in [
        "/v1/tracks/999",
        "/v1/tracks/..",
        "/v1/tracks/x",
        "/v1/tracks/999/events",
    ] {
        get(shared(), path).problem(404, "not-found");
    }
    frame(shared(), "999", 0.0).problem(404, "not-found");
    for (query, said) in [
        ("", "no time_s"),
        ("?time_s=", "time_s is \"\""),
        ("?time_s=nan", "time_s is \"nan\""),
        ("?time_s=inf", "time_s is \"inf\""),
        // Microseconds since 1970.
        (
            "?time_s=1764174757123456",
            "time_s is \"1764174757123456\"; expected the time of the exposure in seconds, -1e12 to 1e12",
        ),
    ] {
        let line = format!("POST /v1/tracks/{id}/frames{query}");
        let refused = send(shared(), &line, &[PHOTO], &area().photo);
        let detail = refused.problem(400, "bad-request");
        assert!(detail.contains(said), "{detail}");
    }
    // The map of a track is in the body; one in the address would not be looked at.
    let refused = send(shared(), "POST /v1/tracks?map=nowhere", &[], &[]);
    let detail = refused.problem(400, "bad-request");
    assert!(detail.contains("{\"map\": \"town\"}"), "{detail}");
    // As the description of the API has it.
    let begun = send(shared(), "POST /v1/tracks", &[], b"null");
    assert_eq!(begun.status, 201);
    send(shared(), "POST /v1/tracks", &[], b"{\"map\": \"nowhere\"}").problem(404, "not-found");
    for no_object in ["[]", "[]x", "1"] {
        let refused = send(shared(), "POST /v1/tracks", &[], no_object.as_bytes());
        let detail = refused.problem(400, "bad-request");
        assert!(detail.contains("expected a JSON object"), "{detail}");
    }
    send(shared(), "POST /v1/tracks", &[], &[b' '; 20_000]).problem(413, "too-large");
    let delete = send(shared(), &format!("DELETE /v1/tracks/{id}"), &[], &[]);
    assert_eq!(delete.status, 204);
    get(shared(), &format!("/v1/tracks/{id}")).problem(404, "not-found");
}

#[test]
fn what_is_full_says_when_to_come_again() {
    let limits = Limits {
        listeners: 1,
        ..Limits::default()
    };
    let running = Running::on_area(limits);
    let address = running.address;
    let seconds = |refused: Answer, kind: &str| -> u64 {
        refused.problem(503, kind);
        refused.header("retry-after").unwrap().parse().unwrap()
    };
    let id = begin(address);
    let _listener = follow(address, &id, "");
    let second = get(address, &format!("/v1/tracks/{id}/events"));
    assert!((1..=60).contains(&seconds(second, "listeners")));
    for _ in 1..64 {
        begin(address);
    }
    let refused = send(address, "POST /v1/tracks", &[], &[]);
    assert!((1..=601).contains(&seconds(refused, "tracks")));
    send(address, &format!("DELETE /v1/tracks/{id}"), &[], &[]);
    begin(address);
}
