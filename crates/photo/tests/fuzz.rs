//! Photos put together at random: the structure of each format is kept and its checksums are right, so that damage reaches what
//! reads the contents. Each input gives a photo within the limits, or an error that names the file.
//!
//! `PROPTEST_CASES` sets the number of inputs of each test (CONTRIBUTING.md, "Fuzzing").

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod photo_files;

use std::path::Path;

use grimnet_photo::{MIN_SIDE_PX, Photo, PhotoLimits};
use photo_files::{gradient, jpeg, with_app1};
use proptest::collection::vec;
use proptest::prelude::*;

/// Inputs of each test in a normal run.
const CASES: u32 = 96;

/// Memory that a photo may take here.
const MAX_MEMORY_BYTES: u64 = 8 << 20;

/// Opens the file as the program does.
fn check(bytes: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frame_0042");
    std::fs::write(&path, bytes).unwrap();
    let mut limits = PhotoLimits::default();
    limits.max_memory_bytes = MAX_MEMORY_BYTES;
    for reduced in [None, Some(64)] {
        match Photo::open_with(&path, reduced, &limits) {
            Ok(photo) => check_photo(&photo),
            Err(error) => assert!(error.to_string().contains("frame_0042"), "{error}"),
        }
    }
}

fn check_photo(photo: &Photo) {
    let (width, height) = photo.full_size_px;
    assert!(width.min(height) >= MIN_SIDE_PX);
    assert!(3 * u64::from(width) * u64::from(height) <= MAX_MEMORY_BYTES);
    let metadata = &photo.metadata;
    if let Some(position) = metadata.position {
        assert!(position.lat_deg.abs() <= 90.0 && position.lon_deg.abs() <= 180.0);
    }
    assert!((1..=8).contains(&metadata.orientation));
    let view = photo.view(&grimnet_photo::ViewPrior::default());
    if let Some(footprint) = view.footprint {
        assert!(footprint.width_m.is_finite() && footprint.width_m > 0.0);
    }
}

/// A number that a parser may stumble over.
fn awkward_u32() -> impl Strategy<Value = u32> {
    prop_oneof![
        0..64u32,
        Just(u32::MAX),
        Just(u32::MAX / 2),
        Just(1 << 16),
        any::<u32>(),
    ]
}

fn body() -> impl Strategy<Value = Vec<u8>> {
    vec(any::<u8>(), 0..200)
}

/// Text with the words of XMP packets in any order.
fn xmp() -> impl Strategy<Value = String> {
    let word = prop_oneof![
        Just("<rdf:Description ".to_owned()),
        Just("<drone-dji:GimbalYawDegree>".to_owned()),
        Just("</drone-dji:GimbalYawDegree>".to_owned()),
        Just(" xmlns:drone-dji=\"http://www.dji.com/drone-dji/1.0/\"".to_owned()),
        Just(" xmlns:x=\"http://pix4d.com/camera/1.0\"".to_owned()),
        Just("/>".to_owned()),
        Just(">".to_owned()),
        Just("<!--".to_owned()),
        Just("<![CDATA[".to_owned()),
        Just("&#x110000;".to_owned()),
        Just("&lt;".to_owned()),
        "[a-z:]{1,12}=\"[-+0-9./eNan]{0,12}\" ",
        "drone-dji:(RelativeAltitude|GimbalPitchDegree|CalibratedFocalLength|GpsLatitude)=\"[-+0-9./eE]{0,9}\" ",
        "\\PC{0,8}",
    ];
    vec(word, 0..40).prop_map(|words| words.concat())
}

/// A directory entry of a TIFF structure: tag, type, count, value or offset.
fn entries() -> impl Strategy<Value = Vec<(u16, u16, u32, u32)>> {
    let tag = prop_oneof![
        Just(0x0112u16), // orientation
        Just(0x8769),    // EXIF directory
        Just(0x8825),    // GPS directory
        Just(0x920A),    // focal length
        Just(0xA405),    // focal length in 35 mm film
        Just(700),       // XMP
        Just(0xA20E),
        0..8u16, // GPS
        any::<u16>(),
    ];
    vec((tag, 0..14u16, awkward_u32(), awkward_u32()), 0..24)
}

/// A TIFF structure of these directories, each after the other; the last one points to `next`.
fn tiff(is_little: bool, directories: &[Vec<(u16, u16, u32, u32)>], next: u32) -> Vec<u8> {
    let two = |v: u16| {
        if is_little {
            v.to_le_bytes()
        } else {
            v.to_be_bytes()
        }
    };
    let four = |v: u32| {
        if is_little {
            v.to_le_bytes()
        } else {
            v.to_be_bytes()
        }
    };
    let mut bytes = if is_little { b"II*\0" } else { b"MM\0*" }.to_vec();
    bytes.extend(four(8));
    for (i, entries) in directories.iter().enumerate() {
        bytes.extend(two(entries.len() as u16));
        for &(tag, kind, count, value) in entries {
            bytes.extend(two(tag));
            bytes.extend(two(kind));
            bytes.extend(four(count));
            bytes.extend(four(value));
        }
        let after = bytes.len() as u32 + 4;
        bytes.extend(four(if i + 1 < directories.len() {
            after
        } else {
            next
        }));
    }
    bytes.resize(bytes.len() + 64, 7);
    bytes
}

/// A PNG of these chunks, their lengths and checksums right.
fn png(chunks: &[([u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, body) in chunks {
        bytes.extend((body.len() as u32).to_be_bytes());
        let start = bytes.len();
        bytes.extend(kind);
        bytes.extend(body);
        let crc = crc32(&bytes[start..]);
        bytes.extend(crc.to_be_bytes());
    }
    bytes
}

/// CRC-32 of PNG (ISO 3309), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(crc & 1));
        }
    }
    !crc
}

/// A zlib stream that holds bytes uncompressed, its checksum right (RFC 1950, RFC 1951).
fn zlib(data: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0x78, 1, 1];
    let length = data.len() as u16;
    bytes.extend(length.to_le_bytes());
    bytes.extend((!length).to_le_bytes());
    bytes.extend(data);
    let (mut a, mut b) = (1u32, 0u32);
    for &byte in data {
        a = (a + u32::from(byte)) % 65_521;
        b = (b + a) % 65_521;
    }
    bytes.extend((b << 16 | a).to_be_bytes());
    bytes
}

proptest! {
    #![proptest_config(grimnet_fuzz::config(CASES))]

    #[test]
    fn jpeg_segments(
        inserted in vec((0xC0..=0xFEu8, body(), -2..3i32), 0..4),
        edits in vec((0.0..1.0f64, any::<u8>()), 0..6),
        cut in prop_oneof![4 => Just(1.0), 1 => 0.0..1.0f64],
    ) {
        let whole = jpeg(&gradient(64, 48));
        let mut bytes = whole[..2].to_vec();
        for (marker, body, error) in &inserted {
            bytes.extend([0xFF, *marker]);
            bytes.extend((body.len() as i32 + 2 + error).max(0).to_be_bytes()[2..].iter());
            bytes.extend(body);
        }
        bytes.extend(&whole[2..]);
        for (at, value) in edits {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = value;
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        check(&bytes);
    }

    #[test]
    fn jpeg_frame_headers(
        size in (any::<u16>(), any::<u16>()),
        small in any::<bool>(),
        sampling in vec((any::<u8>(), any::<u8>(), any::<u8>()), 3),
        restart in any::<u16>(),
        frame_type in 0xC0..=0xC2u8,
    ) {
        let mut bytes = jpeg(&gradient(64, 48));
        let frame = bytes.windows(2).position(|w| w == [0xFF, 0xC0]).unwrap();
        bytes[frame + 1] = frame_type;
        let (width, height) = if small { (size.0 % 400, size.1 % 400) } else { size };
        bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
        bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
        for (i, (id, factors, table)) in sampling.iter().enumerate() {
            let at = frame + 10 + 3 * i;
            // Half of them keep what scans refer to.
            if id % 2 == 0 {
                bytes[at + 1] = factors & 0x33;
                bytes[at + 2] = table & 3;
            }
        }
        let mut interval = vec![0xFF, 0xDD, 0, 4];
        interval.extend(restart.to_be_bytes());
        bytes.splice(2..2, interval);
        check(&bytes);
    }

    #[test]
    fn exif_and_xmp(
        is_little in any::<bool>(),
        directories in vec(entries(), 1..4),
        next in awkward_u32(),
        packet in xmp(),
        container in 0..3u8,
    ) {
        let exif = tiff(is_little, &directories, next);
        let bytes = match container {
            0 => {
                let xmp = [b"http://ns.adobe.com/xap/1.0/\0", packet.as_bytes()].concat();
                with_app1(&jpeg(&gradient(32, 24)), &[[b"Exif\0\0", &exif[..]].concat(), xmp])
            }
            1 => {
                let mut header = 32u32.to_be_bytes().to_vec();
                header.extend(24u32.to_be_bytes());
                header.extend([8, 2, 0, 0, 0]);
                let text = [b"XML:com.adobe.xmp\0\0\0\0\0", packet.as_bytes()].concat();
                png(&[
                    (*b"IHDR", header),
                    (*b"eXIf", exif),
                    (*b"iTXt", text),
                    (*b"IDAT", zlib(&vec![0; 24 * 97])),
                    (*b"IEND", vec![]),
                ])
            }
            _ => exif,
        };
        check(&bytes);
    }

    #[test]
    fn png_chunks(
        width in awkward_u32(),
        height in awkward_u32(),
        depth in prop_oneof![Just(1u8), Just(8), Just(16), any::<u8>()],
        colour in 0..7u8,
        interlaced in 0..2u8,
        pixels in vec(any::<u8>(), 0..3000),
        others in vec((prop_oneof![Just(*b"tRNS"), Just(*b"PLTE"), Just(*b"zTXt"), Just(*b"iCCP"), Just(*b"acTL"), Just(*b"fcTL"), Just(*b"eXIf")], body()), 0..4),
    ) {
        let mut header = width.to_be_bytes().to_vec();
        header.extend(height.to_be_bytes());
        header.extend([depth, colour, 0, 0, interlaced]);
        let mut chunks = vec![(*b"IHDR", header)];
        chunks.extend(others);
        chunks.push((*b"IDAT", zlib(&pixels)));
        chunks.push((*b"IEND", vec![]));
        check(&png(&chunks));
    }

    #[test]
    fn webp_chunks(
        chunks in vec((prop_oneof![Just(*b"VP8X"), Just(*b"VP8L"), Just(*b"VP8 "), Just(*b"ALPH"), Just(*b"ANIM"), Just(*b"ANMF"), Just(*b"EXIF"), Just(*b"XMP ")], body(), -1..2i32), 1..5),
        size in (0..16_384u32, 0..16_384u32),
    ) {
        let mut contents = b"WEBP".to_vec();
        for (kind, body, error) in &chunks {
            let mut body = body.clone();
            match kind {
                b"VP8L" => {
                    let head = (size.0 | size.1 << 14).to_le_bytes();
                    body.splice(0..0, [0x2F, head[0], head[1], head[2], head[3]]);
                }
                b"VP8X" => body.splice(0..0, [0x3C, 0, 0, 0, 63, 0, 0, 47, 0, 0]).for_each(drop),
                _ => {}
            }
            contents.extend(kind);
            contents.extend((body.len() as i32 + error).max(0).to_le_bytes());
            contents.extend(&body);
            if body.len() % 2 == 1 {
                contents.push(0);
            }
        }
        let mut bytes = b"RIFF".to_vec();
        bytes.extend((contents.len() as u32).to_le_bytes());
        bytes.extend(contents);
        check(&bytes);
    }

    #[test]
    fn tiff_pictures(
        is_little in any::<bool>(),
        size in (awkward_u32(), awkward_u32()),
        compression in prop_oneof![Just(1u32), Just(5), Just(7), Just(8), Just(32773), awkward_u32()],
        strips in (awkward_u32(), awkward_u32(), awkward_u32()),
        others in entries(),
    ) {
        let mut directory = vec![
            (256, 4, 1, size.0),
            (257, 4, 1, size.1),
            (258, 3, 1, if is_little { 8 } else { 8 << 16 }),
            (259, 4, 1, compression),
            (262, 3, 1, if is_little { 1 } else { 1 << 16 }),
            (273, 4, 1, strips.0),
            (278, 4, 1, strips.1),
            (279, 4, 1, strips.2),
        ];
        directory.extend(others);
        check(&tiff(is_little, &[directory], 0));
    }
}

/// Half of this packet took 111 s, for each namespace was looked up among all the others.
#[test]
fn a_packet_of_many_namespaces_is_read_in_time() {
    use std::fmt::Write as _;
    let mut packet = String::from("<rdf:Description");
    for i in 0..450_000 {
        let _ = write!(packet, " xmlns:a{i}=\"pix4d.com/camera\"");
    }
    packet += " drone-dji:RelativeAltitude=\"50\"/>";
    let text = [b"XML:com.adobe.xmp\0\0\0\0\0", packet.as_bytes()].concat();
    let bytes = png(&[(*b"iTXt", text)]);
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        let _ = sender.send(grimnet_photo::Metadata::from_bytes(&bytes));
    });
    // A guard against hanging, not a measurement: it takes a second, and minutes if each name is looked up among all others.
    let metadata = receiver
        .recv_timeout(std::time::Duration::from_secs(30))
        .expect("still reading after 30 s");
    assert_eq!(metadata.relative_altitude_m, Some(50.0));
}

#[test]
fn the_golden_files_pass_the_same_checks() {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    for file in ["cmyk.jpg", "palette.png", "progressive.jpg", "restart.jpg"] {
        let photo = Photo::open(golden.join(file)).unwrap();
        check_photo(&photo);
        check(&std::fs::read(golden.join(file)).unwrap());
    }
}
