//! Writes TIFF files for tests, without going through what reads them.

#![allow(dead_code, reason = "each test uses a part of it")]

pub mod usable;

use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// A tag: number, type, count, and value bytes (little-endian).
pub struct Tag(pub u16, pub u16, pub u64, pub Vec<u8>);

pub fn short(tag: u16, values: &[u16]) -> Tag {
    Tag(
        tag,
        3,
        values.len() as u64,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    )
}

pub fn long(tag: u16, values: &[u32]) -> Tag {
    Tag(
        tag,
        4,
        values.len() as u64,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    )
}

pub fn long8(tag: u16, values: &[u64]) -> Tag {
    Tag(
        tag,
        16,
        values.len() as u64,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    )
}

pub fn double(tag: u16, values: &[f64]) -> Tag {
    Tag(
        tag,
        12,
        values.len() as u64,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
    )
}

pub fn ascii(tag: u16, text: &str) -> Tag {
    let bytes = [text.as_bytes(), &[0]].concat();
    Tag(tag, 2, bytes.len() as u64, bytes)
}

/// Tags of an 8-bit RGB picture of `width` x `height`, without blocks.
pub fn rgb_tags(width: u32, height: u32) -> Vec<Tag> {
    vec![
        long(256, &[width]),
        long(257, &[height]),
        short(258, &[8, 8, 8]),
        short(259, &[1]),
        short(262, &[2]),
        short(277, &[3]),
        short(284, &[1]),
    ]
}

/// Tags that place a map: pixels of 0.5 m from (300000, 2700000) in an EPSG code.
pub fn geo_tags(epsg: u16) -> Vec<Tag> {
    vec![
        double(33550, &[0.5, 0.5, 0.0]),
        double(33922, &[0.0, 0.0, 0.0, 300_000.0, 2_700_000.0, 0.0]),
        short(
            34735,
            &[1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, epsg],
        ),
    ]
}

/// Writes a BigTIFF with one image at the start of the file, and leaves the file `length` long at
/// least (sparse where the file system can). Returns where the tags end.
pub fn write_bigtiff(path: &Path, mut tags: Vec<Tag>, length: u64) -> u64 {
    tags.sort_by_key(|t| t.0);
    let mut head = Vec::new();
    head.extend_from_slice(b"II");
    head.extend_from_slice(&43_u16.to_le_bytes());
    head.extend_from_slice(&8_u16.to_le_bytes());
    head.extend_from_slice(&0_u16.to_le_bytes());
    head.extend_from_slice(&16_u64.to_le_bytes());
    head.extend_from_slice(&(tags.len() as u64).to_le_bytes());
    let mut data_at = 16 + 8 + 20 * tags.len() as u64 + 8;
    let mut data = Vec::new();
    for Tag(tag, kind, count, value) in &tags {
        head.extend_from_slice(&tag.to_le_bytes());
        head.extend_from_slice(&kind.to_le_bytes());
        head.extend_from_slice(&count.to_le_bytes());
        if value.len() <= 8 {
            let mut inline = value.clone();
            inline.resize(8, 0);
            head.extend_from_slice(&inline);
        } else {
            head.extend_from_slice(&data_at.to_le_bytes());
            data.extend_from_slice(value);
            data_at += value.len() as u64;
        }
    }
    head.extend_from_slice(&0_u64.to_le_bytes());
    let mut file = std::fs::File::create(path).unwrap();
    file.write_all(&head).unwrap();
    file.write_all(&data).unwrap();
    let end = file.stream_position().unwrap();
    if length > end {
        file.set_len(length).unwrap();
    }
    end
}

/// Writes bytes at a place of a file that exists.
pub fn write_at(path: &Path, offset: u64, bytes: &[u8]) {
    let mut file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
    file.seek(SeekFrom::Start(offset)).unwrap();
    file.write_all(bytes).unwrap();
}

/// An uncompressed RGB map with one strip, `pixel(x, y)` its colours.
pub fn write_map(
    path: &Path,
    size: (u32, u32),
    geo: Vec<Tag>,
    pixel: impl Fn(u32, u32) -> [u8; 3],
) {
    let (width, height) = size;
    let bytes = u64::from(width) * u64::from(height) * 3;
    let at = 4096;
    let mut tags = rgb_tags(width, height);
    tags.extend(geo);
    tags.push(long8(273, &[at]));
    tags.push(long(278, &[height]));
    tags.push(long8(279, &[bytes]));
    assert!(write_bigtiff(path, tags, at + bytes) <= at);
    let colours: Vec<u8> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .flat_map(|(x, y)| pixel(x, y))
        .collect();
    write_at(path, at, &colours);
}
