//! Photo files made in the tests.
#![allow(dead_code, reason = "each test binary uses some of these")]

use exif::experimental::Writer;
use exif::{Field, In, Rational, Tag, Value};
use image::{ImageFormat, Rgb, RgbImage};

/// A picture whose pixels encode where they are: red grows to the right, green downwards.
pub fn gradient(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb([
            (x * 255 / (width - 1).max(1)) as u8,
            (y * 255 / (height - 1).max(1)) as u8,
            90,
        ])
    })
}

/// A file of that picture.
pub fn encoded(image: &RgbImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// A high-quality JPEG of that picture.
pub fn jpeg(image: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 95)
        .encode_image(image)
        .unwrap();
    bytes
}

/// `jpeg` with APP1 segments put in behind its first marker.
pub fn with_app1(jpeg: &[u8], bodies: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = jpeg[..2].to_vec();
    for body in bodies {
        bytes.extend([0xFF, 0xE1]);
        bytes.extend(u16::try_from(body.len() + 2).unwrap().to_be_bytes());
        bytes.extend(body);
    }
    bytes.extend(&jpeg[2..]);
    bytes
}

/// The body of an APP1 segment with an XMP packet.
pub fn xmp_app1(packet: &str) -> Vec<u8> {
    let mut body = b"http://ns.adobe.com/xap/1.0/\0".to_vec();
    body.extend(packet.as_bytes());
    body
}

/// The TIFF structure of EXIF with these fields.
pub fn exif_block(fields: &[(Tag, Value)]) -> Vec<u8> {
    let fields: Vec<Field> = fields
        .iter()
        .map(|(tag, value)| Field {
            tag: *tag,
            ifd_num: In::PRIMARY,
            value: value.clone(),
        })
        .collect();
    let mut writer = Writer::new();
    for field in &fields {
        writer.push_field(field);
    }
    let mut bytes = std::io::Cursor::new(Vec::new());
    writer.write(&mut bytes, true).unwrap();
    bytes.into_inner()
}

/// The body of an APP1 segment with these EXIF fields.
pub fn exif_app1(fields: &[(Tag, Value)]) -> Vec<u8> {
    let mut body = b"Exif\0\0".to_vec();
    body.extend(exif_block(fields));
    body
}

/// One short number.
pub fn short(value: u16) -> Value {
    Value::Short(vec![value])
}

/// One text.
pub fn ascii(text: &str) -> Value {
    Value::Ascii(vec![text.as_bytes().to_vec()])
}

/// Rational numbers.
pub fn rationals(parts: &[(u32, u32)]) -> Value {
    Value::Rational(
        parts
            .iter()
            .map(|&(num, denom)| Rational { num, denom })
            .collect(),
    )
}

/// A GPS position, north-east, in degrees, minutes and hundredths of seconds.
pub fn gps(lat: [u32; 3], lon: [u32; 3], north: &str, east: &str) -> Vec<(Tag, Value)> {
    let angle = |[d, m, s]: [u32; 3]| rationals(&[(d, 1), (m, 1), (s, 100)]);
    vec![
        (Tag::GPSLatitudeRef, ascii(north)),
        (Tag::GPSLatitude, angle(lat)),
        (Tag::GPSLongitudeRef, ascii(east)),
        (Tag::GPSLongitude, angle(lon)),
    ]
}
