//! What the program answers to unusual pictures, metadata, scenes, maps and packs.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageFormat, Rgb, RgbImage, imageops};
use predicates::prelude::*;
use predicates::str::contains;
use serde_json::Value;

use super::noise_map;
use crate::{demo, grim, json, lines, locate, pack, photo};

/// What is known of the photo 1, whatever its file says.
fn known() -> Vec<String> {
    let truth = fs::read_to_string(demo().join("truth.csv")).unwrap();
    let row: Vec<String> = truth
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .map(ToOwned::to_owned)
        .collect();
    [
        "--heading",
        &row[3],
        "--height-agl",
        &row[4],
        "--hfov",
        "70",
    ]
    .map(ToOwned::to_owned)
    .to_vec()
}

fn true_lat_lon_deg() -> [f64; 2] {
    let truth = fs::read_to_string(demo().join("truth.csv")).unwrap();
    let row: Vec<&str> = truth.lines().nth(1).unwrap().split(',').collect();
    [row[1], row[2]].map(|text| text.parse().unwrap())
}

/// `grim locate` with what is known of photo 1.
fn locate_known(photos: &[PathBuf]) -> (Vec<Value>, i32) {
    let known = known();
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    let (text, status) = locate(&known, photos);
    (lines(&text), status)
}

fn assert_right(answer: &Value) {
    assert_eq!(answer["state"], "fix", "{answer}");
    let [lat_deg, lon_deg] = true_lat_lon_deg();
    let north_m = (answer["lat_deg"].as_f64().unwrap() - lat_deg) * 111_000.0;
    let east_m = (answer["lon_deg"].as_f64().unwrap() - lon_deg) * 111_000.0;
    assert!(north_m.hypot(east_m) < 10.0, "{answer}");
}

/// No fix, and a reason that says this.
fn assert_no_fix(answer: &Value, says: &str) {
    assert_eq!(answer["state"], "no_fix", "{answer}");
    let reason = answer["reason"].as_str().unwrap();
    assert!(reason.contains(says), "{says}: {reason}");
}

fn save(image: impl Into<DynamicImage>, path: &Path) -> PathBuf {
    image.into().save(path).unwrap();
    path.to_owned()
}

/// The header of a PNG of this size, and nothing else.
fn png_of_size(width: u32, height: u32, path: &Path) -> PathBuf {
    let mut bytes = Cursor::new(Vec::new());
    RgbImage::new(16, 16)
        .write_to(&mut bytes, ImageFormat::Png)
        .unwrap();
    let mut bytes = bytes.into_inner();
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let crc = crc32(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&crc.to_be_bytes());
    fs::write(path, bytes).unwrap();
    path.to_owned()
}

/// CRC-32 of PNG (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(crc & 1))
        })
    })
}

/// A JPEG whose EXIF has nothing but this orientation.
fn jpeg_of_orientation(image: &RgbImage, orientation: u8, path: &Path) -> PathBuf {
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 92)
        .encode_image(image)
        .unwrap();
    let mut app1 = b"\xFF\xE1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    app1.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    bytes.splice(2..2, app1);
    fs::write(path, bytes).unwrap();
    path.to_owned()
}

/// The stored picture that is displayed as `image` with an EXIF orientation (EXIF 2.32, 4.6.4).
fn stored(image: &RgbImage, orientation: u8) -> RgbImage {
    match orientation {
        2 => imageops::flip_horizontal(image),
        3 => imageops::rotate180(image),
        4 => imageops::flip_vertical(image),
        5 => imageops::flip_horizontal(&imageops::rotate90(image)),
        6 => imageops::rotate270(image),
        7 => imageops::flip_horizontal(&imageops::rotate270(image)),
        8 => imageops::rotate90(image),
        _ => image.clone(),
    }
}

#[test]
fn pictures_that_cannot_be_used_are_named_and_the_next_one_is_answered() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let whole = fs::read(photo(1)).unwrap();
    fs::write(path("truncated.jpg"), &whole[..whole.len() / 2]).unwrap();
    let mut corrupt = whole.clone();
    corrupt[4..40].fill(0x55);
    fs::write(path("corrupt.jpg"), corrupt).unwrap();
    let cases = [
        (path("truncated.jpg"), "is truncated"),
        (path("corrupt.jpg"), "corrupt.jpg"),
        (
            png_of_size(60_000, 60_000, &path("bomb.png")),
            "60000 x 60000 px and needs",
        ),
        (png_of_size(0, 0, &path("nothing.png")), "nothing.png"),
        (save(RgbImage::new(1, 1), &path("dot.png")), "1 x 1 px"),
    ];
    for (bad, says) in cases {
        let (answers, status) = locate_known(&[bad.clone(), photo(1)]);
        assert_eq!(status, 2, "unreadable input");
        assert_no_fix(&answers[0], says);
        assert_no_fix(&answers[0], bad.to_str().unwrap());
        assert_right(&answers[1]);
    }
}

#[test]
fn pictures_of_other_kinds_are_located_as_the_photo_itself() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let picture = image::open(photo(1)).unwrap();
    let rgb = picture.to_rgb8();
    let mut photos = vec![
        save(picture.to_rgb16(), &path("sixteen_bits.png")),
        save(picture.to_luma8(), &path("grey.png")),
        save(picture.to_rgba8(), &path("alpha.png")),
        save(rgb.clone(), &path("photo.tif")),
        save(rgb.clone(), &path("photo.webp")),
    ];
    for orientation in 1..=8 {
        let path = path(&format!("orientation_{orientation}.jpg"));
        photos.push(jpeg_of_orientation(
            &stored(&rgb, orientation),
            orientation,
            &path,
        ));
    }
    let (answers, status) = locate_known(&photos);
    assert_eq!(status, 0, "{answers:?}");
    answers.iter().for_each(assert_right);
}

#[test]
fn metadata_that_cannot_be_true_are_unknown_and_it_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let rgb = image::open(photo(1)).unwrap().to_rgb8();
    let plain = jpeg_of_orientation(&rgb, 1, &folder.path().join("plain.jpg"));
    // Nothing is known: neither scale nor heading.
    let (text, _) = locate(&[], std::slice::from_ref(&plain));
    let answer = lines(&text).remove(0);
    match answer["state"].as_str().unwrap() {
        "fix" => assert_right(&answer),
        _ => assert!(answer["reason"].as_str().unwrap().len() > 20, "{answer}"),
    }
    let assumed = answer["assumed"].as_str().unwrap();
    assert!(assumed.contains("ground width"), "{answer}");
    // Height above the sea, a heading that is no number, a focal length of nothing.
    let xmp = "<x:xmpmeta xmlns:drone-dji=\"http://www.dji.com/drone-dji/1.0/\"><rdf:Description \
               drone-dji:AbsoluteAltitude=\"+160\" drone-dji:GimbalYawDegree=\"nan\" drone-dji:GimbalPitchDegree=\"-90\" \
               drone-dji:CalibratedFocalLength=\"0\"/></x:xmpmeta>";
    let mut body = b"http://ns.adobe.com/xap/1.0/\0".to_vec();
    body.extend(xmp.as_bytes());
    let mut bytes = fs::read(&plain).unwrap();
    let mut segment = vec![0xFF, 0xE1];
    segment.extend((body.len() as u16 + 2).to_be_bytes());
    segment.extend(body);
    bytes.splice(2..2, segment);
    fs::write(&plain, bytes).unwrap();
    let (text, _) = locate(&[], &[plain]);
    let answer = lines(&text).remove(0);
    assert!(
        !answer["set_aside"].as_array().unwrap().is_empty(),
        "{answer}"
    );
    if answer["state"] == "fix" {
        assert_right(&answer);
    }
}

/// Pixels from a rule that repeats itself.
fn pattern(tone: impl Fn(u32, u32) -> u8) -> RgbImage {
    RgbImage::from_fn(1200, 900, |x, y| {
        let tone = tone(x, y);
        Rgb([tone, tone, tone.saturating_add(8)])
    })
}

#[test]
fn scenes_without_a_place_get_no_fix() {
    let folder = tempfile::tempdir().unwrap();
    let rgb = image::open(photo(1)).unwrap().to_rgb8();
    let scenes = [
        ("snow", pattern(|_, _| 250)),
        (
            "cloud",
            imageops::blur(&pattern(|x, y| (x / 9 + y / 7) as u8), 30.0),
        ),
        ("night", pattern(|x, y| (x * y % 3) as u8)),
        (
            "water",
            pattern(|x, y| (90.0 + 6.0 * (f64::from(x + 2 * y) / 4.0).sin()) as u8),
        ),
        ("blur", imageops::blur(&rgb, 40.0)),
        (
            "rows",
            pattern(|x, y| if (x / 20 + y / 20) % 2 == 0 { 70 } else { 150 }),
        ),
        // Another place, with the texture of this one.
        ("elsewhere", imageops::flip_horizontal(&rgb)),
    ];
    let photos: Vec<PathBuf> = scenes
        .into_iter()
        .map(|(name, image)| save(image, &folder.path().join(format!("{name}.png"))))
        .collect();
    let (answers, status) = locate_known(&photos);
    assert_eq!(status, 1, "{answers:?}");
    for answer in &answers {
        assert_no_fix(answer, " ");
        assert!(answer["reason"].as_str().unwrap().len() > 20, "{answer}");
    }
    // The right photo on the wrong part of the map, and on no part of it.
    for near in ["52.5,13.4,100", "1.0,1.5,1"] {
        let (text, status) = locate(&["--near", near], &[photo(1)]);
        assert_eq!(status, 1, "{text}");
    }
}

#[test]
fn maps_that_do_not_say_where_they_are_give_no_pack() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let map = path("map.png");
    noise_map(&map, 700, 1);
    let refused = |arguments: &[&str], says: &[&str]| {
        let out = path("x.grim");
        let assert = grim()
            .args(["map", "build", "-o"])
            .args([&out, &map])
            .args(arguments)
            .assert()
            .code(2);
        for word in says {
            let assert = assert.get_output().clone();
            let errors = String::from_utf8(assert.stderr).unwrap();
            assert!(errors.contains(word), "{arguments:?}: {word}: {errors}");
        }
        assert!(!out.exists() && !path("x.grim.partial").exists());
    };
    refused(&[], &["map.png", "--corners"]);
    // Latitude and longitude exchanged, where that can be told.
    refused(
        &["--corners", "24.2,120.7,24.3,120.8"],
        &["corners", "latitude"],
    );
    refused(&["--corners", "13.4,52.5,13.4,52.5"], &["corners"]);
    // A world file whose transform maps everything onto a line, then one without coordinate system.
    fs::write(path("map.pgw"), "1\n1\n1\n1\n500000\n5800000\n").unwrap();
    refused(&["--crs", "EPSG:32633"], &["map."]);
    fs::write(path("map.pgw"), "0.3\n0\n0\n-0.3\n500000\n5800000\n").unwrap();
    refused(&[], &["map.", "--crs"]);
    refused(&["--crs", "EPSG:999999"], &["999999"]);
    // Rotated by thirty degrees, which is where it is.
    fs::write(
        path("map.pgw"),
        "0.26\n0.15\n0.15\n-0.26\n500000\n5800000\n",
    )
    .unwrap();
    let out = path("turned.grim");
    let built = |map: &Path, arguments: &[&str]| {
        grim()
            .args(["map", "build", "--overwrite", "-o"])
            .args([&out, map])
            .args(arguments)
            .assert()
            .success();
        let info = grim()
            .args(["map", "info", "--json"])
            .arg(&out)
            .output()
            .unwrap();
        serde_json::from_slice::<Value>(&info.stdout).unwrap()
    };
    built(&map, &["--crs", "EPSG:32633", "--gsd", "0.3"]);
    fs::remove_file(path("map.pgw")).unwrap();
    // Smaller than a tile; across the antimeridian; 100,000 pixels wide.
    let small = path("small.png");
    noise_map(&small, 150, 2);
    built(&small, &["--corners", "13.4,52.5,13.4006,52.5004"]);
    let info = built(
        &map,
        &[
            "--corners",
            "179.999,-16.5,-179.999,-16.498",
            "--gsd",
            "0.3",
        ],
    );
    assert!(info.to_string().len() > 100);
    let wide = path("wide.png");
    RgbImage::from_fn(100_000, 40, |x, y| {
        let tone = (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(40_503)) >> 13;
        Rgb([tone as u8, (tone >> 3) as u8, (tone >> 5) as u8])
    })
    .save(&wide)
    .unwrap();
    built(
        &wide,
        &["--corners", "13.0,52.5,13.44,52.500108", "--gsd", "0.3"],
    );
}

#[test]
fn packs_that_do_not_fit_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.grim");
    let whole = fs::read(pack()).unwrap();
    let mut older = whole.clone();
    older[8..12].copy_from_slice(&0_u32.to_le_bytes());
    for (bytes, says, what_to_do) in [
        (&whole[..whole.len() / 2], "truncated", "build"),
        (&[][..], "truncated", "build"),
        (b"a letter to somebody", "not a grimnet pack", "build"),
        (&older[..], "pack format 0", "build the pack again"),
    ] {
        fs::write(&path, bytes).unwrap();
        for command in [
            &["map", "info"][..],
            &["map", "verify"],
            &["locate", "--pack"],
        ] {
            let photo = (command[0] == "locate").then(|| photo(1));
            grim()
                .args(command)
                .arg(&path)
                .args(photo)
                .assert()
                .code(2)
                .stderr(
                    contains("x.grim")
                        .and(contains(says))
                        .and(contains(what_to_do)),
                );
        }
    }
    // Another model than the pack's.
    let spec = grimnet_net::NetSpec::compact();
    let model = folder.path().join("other.safetensors");
    grimnet_net::Model::random(&spec, 5)
        .unwrap()
        .save(&model)
        .unwrap();
    grim()
        .args(["locate", "--pack"])
        .arg(pack())
        .arg(photo(1))
        .arg("--model")
        .arg(&model)
        .assert()
        .code(2)
        .stderr(contains("model"));
    assert!(json(&demo().join("summary.json")).is_object());
}
