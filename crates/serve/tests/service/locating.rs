//! Photos in, positions out.

use grimnet::{Photo, Prior};
use grimnet_serve::{Access, Limits};
use serde_json::{Value, json};

use crate::area::{POSE, Running, area, shared};
use crate::client::{FORM, form, get, send};

const PHOTO: &str = "content-type: image/jpeg";

#[test]
fn a_photo_as_a_body_is_answered_as_by_the_library() {
    let answer = send(
        shared(),
        "POST /v1/locate?name=a.jpg",
        &[PHOTO],
        &area().photo,
    );
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), Some("application/json"));
    let text = answer.text();
    assert!(text.ends_with("}\n") && text.lines().count() == 1, "{text}");
    let found = answer.json();

    let photo = Photo::from_bytes("a.jpg", &area().photo, Some(2048)).unwrap();
    let outcome = area().localizer().locate(&photo, &Prior::none()).unwrap();
    let mut expected = serde_json::to_value(grimnet_answer::Answer::of("a.jpg", &outcome)).unwrap();
    let mut same = found.clone();
    for answer in [&mut expected, &mut same] {
        answer.as_object_mut().unwrap().remove("time_ms");
    }
    assert_eq!(same, expected);
    let fix = |name: &str| found[name].as_f64().unwrap();
    let error_m = area().error_m(fix("lat_deg"), fix("lon_deg"));
    assert!(error_m < 2.0, "{error_m} m");
    assert!(found["time_ms"]["total"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_form_with_a_prior_is_answered() {
    let prior = json!({ "heading": POSE.heading_deg, "height_agl_m": 90.0, "hfov_deg": 70.0 });
    let body = form(&[
        ("prior", None, prior.to_string().as_bytes()),
        ("photo", Some("../flight/b.jpg"), &area().photo),
    ]);
    let answer = send(shared(), "POST /v1/locate?detail=true", &[FORM], &body);
    assert_eq!(answer.status, 200, "{}", answer.text());
    let answer = answer.json();
    assert_eq!(answer["photo"], "b.jpg", "a name, no path");
    assert_eq!(answer["state"], "fix");
    assert_eq!(answer["detail"]["heading_deg"], POSE.heading_deg);
    assert_eq!(answer["detail"]["height_agl_m"], 90.0);
    assert_eq!(answer["detail"]["map"], "area");
    let picture = answer["detail"]["matches_jpeg_base64"].as_str().unwrap();
    assert!(picture.starts_with("/9j/"), "a JPEG in base64");
}

#[test]
fn the_client_chooses_the_format() {
    for (accept, start) in [
        ("application/json", "{\"photo\""),
        ("application/x-ndjson", "{\"photo\""),
        ("application/geo+json", "{\"type\":\"FeatureCollection\""),
        ("application/vnd.google-earth.kml+xml", "<?xml"),
        ("application/gpx+xml", "<?xml"),
        ("text/csv", "photo,state"),
    ] {
        let headers = [PHOTO, &format!("accept: {accept}")];
        let answer = send(shared(), "POST /v1/locate", &headers, &area().photo);
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert_eq!(answer.header("content-type"), Some(accept));
        assert!(answer.text().starts_with(start), "{}", answer.text());
    }
    let headers = [PHOTO, "accept: image/png"];
    send(shared(), "POST /v1/locate", &headers, &area().photo).problem(406, "not-acceptable");
}

#[test]
fn a_photo_of_another_place_has_no_fix_and_a_reason() {
    let noise = image::RgbImage::from_fn(640, 480, |x, y| {
        let mixed =
            (x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663)).wrapping_mul(2_654_435_761);
        image::Rgb([(mixed >> 8) as u8, (mixed >> 16) as u8, (mixed >> 24) as u8])
    });
    let mut png = std::io::Cursor::new(Vec::new());
    noise.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let query = "heading=unknown&height_agl_m=90&hfov_deg=70";
    let answer = send(
        shared(),
        &format!("POST /v1/locate?{query}"),
        &["content-type: image/png"],
        png.get_ref(),
    );
    assert_eq!(answer.status, 200, "{}", answer.text());
    let answer = answer.json();
    assert_eq!(answer["state"], "no_fix");
    assert_eq!(answer["lat_deg"], Value::Null);
    assert!(!answer["reason"].as_str().unwrap().is_empty());
}

#[test]
fn maps_are_listed_and_chosen() {
    let maps = get(shared(), "/v1/maps").json();
    let map = &maps["maps"][0];
    assert_eq!(map["id"], "area");
    assert_eq!(map["has_picture"], true);
    assert!((map["levels"][0]["gsd_m"].as_f64().unwrap() - 0.3).abs() < 1e-6);
    let bounds: Vec<f64> = serde_json::from_value(map["bounds_deg"].clone()).unwrap();
    let [lon_deg, lat_deg] = area().truth;
    assert!(bounds[0] < lon_deg && lon_deg < bounds[2], "{bounds:?}");
    assert!(bounds[1] < lat_deg && lat_deg < bounds[3], "{bounds:?}");

    let maps = vec![area().served("Area", false), area().served("area", false)];
    let two = Running::start(Access::ThisMachine, maps, Limits::default());
    let names = get(two.address, "/v1/maps").json();
    assert_eq!(names["maps"][1]["id"], "area-2");
    assert_eq!(names["maps"][0]["has_picture"], false);
    let post = |query: &str| {
        let line = format!("POST /v1/locate{query}");
        send(two.address, &line, &[PHOTO], &area().photo)
    };
    assert!(post("").problem(422, "bad-value").contains("area-2"));
    post("?map=town").problem(404, "not-found");
    assert_eq!(post("?map=area-2").json()["state"], "fix");
}

#[test]
fn health_figures_and_description() {
    assert_eq!(get(shared(), "/healthz").text(), "ok\n");
    send(shared(), "POST /v1/locate", &[PHOTO], &area().photo);
    let metrics = get(shared(), "/metrics");
    assert!(
        metrics
            .header("content-type")
            .unwrap()
            .contains("version=0.0.4")
    );
    let text = metrics.text();
    for expected in [
        "grimnet_requests_total{method=\"POST\",route=\"/v1/locate\",status=\"200\"}",
        "grimnet_localisations_total{map=\"area\",state=\"fix\"}",
        "grimnet_localisation_seconds_bucket{le=\"+Inf\"}",
    ] {
        assert!(text.contains(expected), "{text}");
    }
    let api = get(shared(), "/openapi.json").json();
    for path in ["/v1/locate", "/v1/maps", "/healthz", "/metrics"] {
        assert!(api["paths"][path].is_object(), "{path}");
    }
    let page = get(shared(), "/api");
    assert!(page.text().contains("/web/api.js"));
    let policy = page.header("content-security-policy").unwrap();
    assert!(policy.contains("default-src 'none'"), "{policy}");
}

#[test]
fn open_requests_are_answered_when_the_service_stops() {
    let mut running = Running::on_area(Limits::default());
    let address = running.address;
    let stop = running.stop.clone();
    let asked =
        std::thread::spawn(move || send(address, "POST /v1/locate", &[PHOTO], &area().photo));
    // The request has arrived when the service counts it.
    while !get(address, "/metrics")
        .text()
        .contains("grimnet_localisations_running 1")
    {
        if asked.is_finished() {
            break;
        }
    }
    stop.stop();
    assert_eq!(asked.join().unwrap().json()["state"], "fix");
    running.end();
    assert!(std::net::TcpStream::connect(address).is_err());
}
