//! Picture files that are small, and would be large or slow to decode.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};

/// A chunk of a PNG file (ISO/IEC 15948, 5.3).
fn chunk(kind: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut checked = kind.to_vec();
    checked.extend_from_slice(content);
    let mut crc = flate2::Crc::new();
    crc.update(&checked);
    let mut chunk = u32::try_from(content.len()).unwrap().to_be_bytes().to_vec();
    chunk.extend_from_slice(&checked);
    chunk.extend_from_slice(&crc.sum().to_be_bytes());
    chunk
}

fn deflated_zeros(bytes: usize) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    for _ in 0..bytes >> 20 {
        encoder.write_all(&[0; 1 << 20]).unwrap();
    }
    encoder.finish().unwrap()
}

/// A PNG file of one colour type and bit depth, with chunks before its pixels, which are all zero and too few.
fn png(side_px: u32, depth: u8, colour: u8, between: &[Vec<u8>]) -> Vec<u8> {
    let mut header = [side_px.to_be_bytes(), side_px.to_be_bytes()].concat();
    header.extend_from_slice(&[depth, colour, 0, 0, 0]);
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    file.extend(chunk(b"IHDR", &header));
    for chunk in between {
        file.extend_from_slice(chunk);
    }
    file.extend(chunk(b"IDAT", &deflated_zeros(1 << 20)));
    file.extend(chunk(b"IEND", &[]));
    file
}

/// 900 million pixels in a kilobyte.
pub fn png_of_many_pixels() -> Vec<u8> {
    png(30_000, 8, 2, &[])
}

/// Fewer pixels of 8 bytes.
pub fn png_of_deep_pixels() -> Vec<u8> {
    png(9_000, 16, 6, &[])
}

/// A small picture with a colour profile that is a gigabyte when it is decompressed.
pub fn png_of_large_profile() -> Vec<u8> {
    let profile = [b"p\0\0".to_vec(), deflated_zeros(1 << 30)].concat();
    png(64, 8, 2, &[chunk(b"iCCP", &profile)])
}

/// A small picture with a hundred texts of 64 MiB when they are decompressed.
pub fn png_of_large_texts() -> Vec<u8> {
    let text = [b"t\0\0".to_vec(), deflated_zeros(64 << 20)].concat();
    png(64, 8, 2, &vec![chunk(b"zTXt", &text); 100])
}

/// A gzip stream of 256 MiB of zeros.
pub fn gzip() -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    for _ in 0..256 {
        encoder.write_all(&[0; 1 << 20]).unwrap();
    }
    encoder.finish().unwrap()
}

/// A JPEG file that claims 65,535 x 65,535 pixels.
pub fn jpeg_of_many_pixels(photo: &[u8]) -> Vec<u8> {
    let mut jpeg = photo.to_vec();
    let frame = jpeg.windows(2).rposition(|w| w == [0xFF, 0xC0]).unwrap();
    jpeg[frame + 5..frame + 9].fill(0xFF);
    jpeg
}

/// A progressive JPEG file (ITU-T T.81, annex G) that goes over its 4,096 x 4,096 pixels twenty thousand times.
pub fn jpeg_of_many_scans() -> Vec<u8> {
    let mut file = vec![0xFF, 0xD8];
    let mut segment = |marker: u8, content: &[u8]| {
        file.extend_from_slice(&[0xFF, marker]);
        file.extend_from_slice(&u16::try_from(content.len() + 2).unwrap().to_be_bytes());
        file.extend_from_slice(content);
    };
    segment(0xDB, &[&[0][..], &[1; 64]].concat());
    // One grey component.
    segment(0xC2, &[8, 0x10, 0, 0x10, 0, 1, 1, 0x11, 0]);
    // Of direct current the category 0, of alternating current a run of 2^14 or more empty blocks: one code each, of one bit.
    let table = |class: u8, symbol: u8| {
        let mut table = vec![class, 1];
        table.extend_from_slice(&[0; 15]);
        table.push(symbol);
        table
    };
    segment(0xC4, &table(0x00, 0));
    segment(0xC4, &table(0x10, 0xE0));
    // 512 x 512 blocks, a bit each.
    segment(0xDA, &[1, 1, 0, 0, 0, 0]);
    file.extend_from_slice(&[0; 512 * 512 / 8]);
    for _ in 0..20_000 {
        file.extend_from_slice(&[0xFF, 0xDA, 0, 8, 1, 1, 0, 1, 63, 0]);
        // Sixteen runs of 2^14 blocks: a code and 14 bits each.
        file.extend_from_slice(&[0; 30]);
    }
    file.extend_from_slice(&[0xFF, 0xD9]);
    file
}

/// A TIFF file that claims 60,000 x 60,000 pixels in one strip.
pub fn tiff_of_many_pixels() -> Vec<u8> {
    let entries: [(u16, u16, u32); 9] = [
        (256, 4, 60_000),
        (257, 4, 60_000),
        (258, 3, 8),
        (259, 3, 8),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 4, 60_000),
        (279, 4, 64),
    ];
    let mut file = b"II*\0".to_vec();
    file.extend_from_slice(&8_u32.to_le_bytes());
    file.extend_from_slice(&u16::try_from(entries.len()).unwrap().to_le_bytes());
    for (tag, kind, value) in entries {
        file.extend_from_slice(&tag.to_le_bytes());
        file.extend_from_slice(&kind.to_le_bytes());
        file.extend_from_slice(&1_u32.to_le_bytes());
        file.extend_from_slice(&value.to_le_bytes());
    }
    file.extend_from_slice(&[0; 4]);
    file
}

/// The first bytes of a lossless WebP file of 16,383 x 16,383 pixels (RFC 9649).
pub fn webp_of_many_pixels() -> Vec<u8> {
    let mut file = b"RIFF\x20\0\0\0WEBPVP8L\x14\0\0\0\x2f\xfe\xbf\xff\x0f".to_vec();
    file.resize(40, 0);
    file
}
