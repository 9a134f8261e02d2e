//! Tiles of the map and of the pack, and the page.

use grimnet_serve::{Access, Limits};
use image::RgbImage;

use crate::area::{Running, area, shared};
use crate::client::{Answer, get, send, send_raw};

/// Column and row of the tile of `zoom` that holds a position, and the pixel in it.
fn tile_of(zoom: u32, [lon_deg, lat_deg]: [f64; 2]) -> ([u32; 2], [u32; 2]) {
    // https://wiki.openstreetmap.org/wiki/Slippy_map_tilenames
    let tiles = f64::from(1 << zoom);
    let lat = lat_deg.to_radians();
    let x = (lon_deg + 180.0) / 360.0 * tiles;
    let y = (1.0 - (lat.tan() + 1.0 / lat.cos()).ln() / std::f64::consts::PI) / 2.0 * tiles;
    let pixel = |along: f64| ((along - along.floor()) * 256.0) as u32;
    ([x as u32, y as u32], [pixel(x), pixel(y)])
}

fn picture(answer: &Answer) -> image::RgbaImage {
    assert_eq!(answer.status, 200, "{}", answer.head);
    image::load_from_memory(&answer.body).unwrap().into_rgba8()
}

/// The map's own file, whose pixel under a position is known from its affine transform.
fn map_colour(at: [f64; 2]) -> [f64; 3] {
    let map = grimnet_geo::open_map(&area().file("map.tif"), &Default::default()).unwrap();
    let place = grimnet_geo::LonLat {
        lon_deg: at[0],
        lat_deg: at[1],
    };
    let px = map.georeference().map_px_from_lonlat(place).unwrap();
    let window = grimnet_geo::WindowPx::new(px.x - 8.0, px.y - 8.0, 16.0, 16.0);
    mean(&map.read(window, 16, 16).unwrap().rgb)
}

fn mean(picture: &RgbImage) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for pixel in picture.pixels() {
        for (sum, &sample) in sum.iter_mut().zip(&pixel.0) {
            *sum += f64::from(sample) / f64::from(picture.width() * picture.height());
        }
    }
    sum
}

#[test]
fn tiles_show_the_map_where_it_lies() {
    let described = get(shared(), "/v1/maps/area/tilejson.json").json();
    let zoom = described["maxzoom"].as_u64().unwrap() as u32;
    assert_eq!(zoom, 19, "0.3 m near the equator");
    let template = format!("http://{}/v1/maps/area/tiles/{{z}}/{{x}}/{{y}}", shared());
    assert_eq!(described["tiles"][0], template);
    // An absolute address names the host, whatever the header says.
    let line = format!("GET http://{}/v1/maps/area/tilejson.json", shared());
    let head = format!("{line} HTTP/1.1\r\nhost: evil.example\r\nconnection: close\r\n\r\n");
    let absolute = Answer::of(&send_raw(shared(), head.as_bytes())).json();
    assert_eq!(absolute["tiles"][0], template);
    for east_m in [-60.0, -20.0, 30.0, 80.0] {
        let at = [area().truth[0] + east_m / 111_320.0, area().truth[1]];
        let ([x, y], [i, j]) = tile_of(zoom, at);
        let answer = get(shared(), &format!("/v1/maps/area/tiles/{zoom}/{x}/{y}"));
        let tile = image::DynamicImage::ImageRgba8(picture(&answer)).into_rgb8();
        // 16 pixels around it, as far as they are in the tile: pixels of both are 0.3 m wide.
        let (left, top) = (i.clamp(8, 248) - 8, j.clamp(8, 248) - 8);
        let around = image::imageops::crop_imm(&tile, left, top, 16, 16).to_image();
        if (8..=248).contains(&i) && (8..=248).contains(&j) {
            for (found, expected) in mean(&around).into_iter().zip(map_colour(at)) {
                assert!(
                    (found - expected).abs() < 6.0,
                    "{found} {expected} at {east_m} m"
                );
            }
        }
    }
}

#[test]
fn tiles_are_opaque_inside_and_transparent_outside() {
    let (at, _) = tile_of(19, area().truth);
    let path = |x: u32, y: u32| format!("/v1/maps/area/tiles/19/{x}/{y}.png");
    let inside = get(shared(), &path(at[0], at[1]));
    assert_eq!(inside.header("content-type"), Some("image/jpeg"));
    let outside = get(shared(), &path(at[0] + 100, at[1]));
    assert_eq!(outside.header("content-type"), Some("image/png"));
    assert!(picture(&outside).pixels().all(|pixel| pixel.0[3] == 0));
    // The whole map in a tile: partly transparent.
    let (at, _) = tile_of(15, area().truth);
    let whole = picture(&get(
        shared(),
        &format!("/v1/maps/area/tiles/15/{}/{}", at[0], at[1]),
    ));
    let opaque = whole.pixels().filter(|pixel| pixel.0[3] == 255).count();
    // 420 m of 1223 m.
    assert!((1000..30_000).contains(&opaque), "{opaque}");

    let tag = inside.header("etag").unwrap();
    let ([x, y], _) = tile_of(19, area().truth);
    let again = send(
        shared(),
        &format!("GET {}", path(x, y)),
        &[&format!("if-none-match: \"x\", W/{tag}")],
        &[],
    );
    assert_eq!((again.status, again.body.len()), (304, 0));
}

#[test]
fn without_a_map_tiles_show_the_pack() {
    let maps = vec![area().served("area", false)];
    let running = Running::start(Access::ThisMachine, maps, Limits::default());
    let ([x, y], [i, j]) = tile_of(17, area().truth);
    let path = format!("/v1/maps/area/tiles/17/{x}/{y}");
    let drawn = picture(&get(running.address, &path));
    assert!(
        drawn.get_pixel(i, j).0[3] > 0,
        "the middle of the map has tiles"
    );
    let as_layer = get(shared(), &format!("{path}?layer=outlines"));
    assert_eq!(picture(&as_layer), drawn);
}

#[test]
fn tiles_that_do_not_exist() {
    for tile in [
        "19/0",
        "19/600000/0",
        "2/0/0",
        "30/0/0",
        "19/-1/0",
        "a/b/c",
        "19/1/1.svg",
    ] {
        get(shared(), &format!("/v1/maps/area/tiles/{tile}")).problem(404, "not-found");
    }
    get(shared(), "/v1/maps/town/tiles/19/0/0").problem(404, "not-found");
    for query in ["layer=secret", "layer=map&layer=map"] {
        let line = format!("/v1/maps/area/tiles/19/0/0?{query}");
        get(shared(), &line).problem(400, "bad-request");
    }
}

#[test]
fn the_page_and_its_parts_are_small_and_complete() {
    let page = get(shared(), "/").text();
    let mut bytes = 0;
    for path in [
        "/",
        "/web/page.js",
        "/web/page.css",
        "/web/style.css",
        "/web/service.js",
        "/web/map_view.js",
        "/web/tracks.js",
        "/web/maplibre-gl.mjs",
        "/web/maplibre-gl-worker.mjs?v=6.17.0",
        "/web/maplibre-gl.css",
    ] {
        let part = send(
            shared(),
            &format!("GET {path}"),
            &["accept-encoding: gzip"],
            &[],
        );
        assert_eq!(part.status, 200, "{path}");
        assert_eq!(part.header("content-encoding"), Some("gzip"));
        let script = path.contains("js");
        assert_eq!(
            part.header("content-type")
                .unwrap()
                .starts_with("text/javascript"),
            script
        );
        bytes += part.body.len();
    }
    assert!(bytes < 2_000_000, "{bytes} bytes are transferred");
    assert!(
        !page.contains("http://") && !page.contains("https://"),
        "nothing of another host"
    );
    assert!(
        get(shared(), "/web/maplibre-gl-licence.txt")
            .text()
            .contains("MapLibre contributors")
    );
}

#[test]
fn answers_are_written_in_other_formats() {
    let answers = r#"[{"photo":"a.jpg","state":"fix","lat_deg":1.5,"lon_deg":2.5},{"photo":"b.jpg","state":"no_fix","reason":"dark"}]"#;
    let headers = [
        "content-type: application/json",
        "accept: application/gpx+xml",
    ];
    let gpx = send(shared(), "POST /v1/answers", &headers, answers.as_bytes());
    assert_eq!(gpx.text().matches("<wpt ").count(), 1);
    let post = |headers: &[&str]| send(shared(), "POST /v1/answers", headers, answers.as_bytes());
    let lines = post(&[]);
    let lines_type = "application/x-ndjson";
    assert_eq!(lines.header("content-type"), Some(lines_type));
    assert_eq!(lines.text().lines().count(), 2);
    let list = post(&["accept: application/json"]);
    assert_eq!(list.header("content-type"), Some("application/json"));
    assert_eq!(list.json()[1]["photo"], "b.jpg");
    let api = get(shared(), "/openapi.json").json();
    let described = &api["paths"]["/v1/answers"]["post"]["responses"]["200"]["content"];
    for media_type in described.as_object().unwrap().keys() {
        let answer = post(&[&format!("accept: {media_type}")]);
        assert_eq!(answer.header("content-type"), Some(media_type.as_str()));
    }
    let single = send(shared(), "POST /v1/answers", &headers, b"{}");
    let said = single.problem(400, "bad-request");
    assert!(said.contains("no JSON array"), "{said}");
    let long = vec![b'['; 9 << 20];
    send(shared(), "POST /v1/answers", &headers, &long).problem(413, "too-large");
}
