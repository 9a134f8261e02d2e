//! Decoding a baseline JPEG at half, a quarter or an eighth of its size.
//!
//! The entropy-coded data are read once, in parts side by side ([`part`], [`join`]); that also finds damage. Each block's
//! coefficients are transformed to as many samples as are wanted ([`basis`]), and only these are converted to RGB ([`picture`]).

mod basis;
mod cursor;
mod join;
mod layout;
mod part;
mod picture;
mod reduction;

use image::RgbImage;

use crate::bits::Bits;
use crate::damage::{Checked, Damage};
use crate::scan_header::ScanHeaders;
use crate::structure::Frame;
use cursor::Cursor;
use layout::Layout;

pub(crate) use part::part_count;
pub use reduction::Reduction;

/// Decodes a file that consists of one scan, read in `part_count` parts, which does not change the answer; `None` if it is of a kind that cannot be reduced here.
///
/// # Errors
/// [`Damage`] if the compressed data contradict the frame header.
pub(crate) fn decode(
    bytes: &[u8],
    frame: &Frame,
    reduction: Reduction,
    part_count: usize,
) -> Checked<Option<RgbImage>> {
    let mut headers = ScanHeaders::new(bytes);
    let Some(header) = headers.next_scan()? else {
        return Ok(None);
    };
    let Some(layout) = Layout::new(frame, &headers.tables, header, reduction)? else {
        return Ok(None);
    };
    let at = headers.at;
    let start = Cursor::at_interval(&layout, Bits::new(bytes, at), 0);
    let parts = part::read_parts(&layout, bytes, at, part_count);
    let scan = join::join(&layout, parts, start)?;
    let picture = picture::picture(&layout, &scan, reduction.size_px(frame.size_px))?;
    headers.at = scan.end;
    match headers.next_scan()? {
        None => Ok(Some(picture)),
        Some(_) => Err(Damage::ScanHeader),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::structure::JpegStructure;

    fn golden(name: &str) -> Vec<u8> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden");
        std::fs::read(format!("{folder}/{name}.jpg")).unwrap()
    }

    fn decoded(bytes: &[u8], reduction: Reduction, part_count: usize) -> Checked<RgbImage> {
        let structure = JpegStructure::read(bytes).unwrap();
        decode(bytes, &structure.frame, reduction, part_count).map(Option::unwrap)
    }

    /// A JPEG with texture and a plain part, of some 300 kB.
    fn large() -> Vec<u8> {
        let mut noise = 1u32;
        let image = RgbImage::from_fn(803, 605, |x, y| {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let wave = 60.0 * ((f64::from(x) / 5.0).sin() + (f64::from(y) / 7.0).cos());
            let tone = (128.0 + wave) as u8 / 2;
            let tone = if y < 200 {
                90
            } else {
                tone + (noise >> 26) as u8
            };
            image::Rgb([tone, tone / 2 + (noise >> 28) as u8, 255 - tone])
        });
        let mut bytes = Vec::new();
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 90)
            .encode_image(&image)
            .unwrap();
        bytes
    }

    #[test]
    fn the_number_of_parts_does_not_change_the_picture() {
        for name in ["444", "422", "420", "grey", "restart", "optimised"] {
            let bytes = golden(name);
            let whole = decoded(&bytes, Reduction::Quarter, 1).unwrap();
            for part_count in 2..12 {
                assert_eq!(
                    decoded(&bytes, Reduction::Quarter, part_count),
                    Ok(whole.clone())
                );
            }
        }
        let bytes = large();
        let whole = decoded(&bytes, Reduction::Half, 1).unwrap();
        for part_count in [2, 3, 4, 9] {
            assert_eq!(
                decoded(&bytes, Reduction::Half, part_count),
                Ok(whole.clone())
            );
        }
    }

    /// Otherwise parts would be read in vain.
    #[test]
    fn most_of_each_part_is_used() {
        let bytes = large();
        let structure = JpegStructure::read(&bytes).unwrap();
        let mut headers = ScanHeaders::new(&bytes);
        let header = headers.next_scan().unwrap().unwrap();
        let layout = Layout::new(&structure.frame, &headers.tables, header, Reduction::Half);
        let layout = layout.unwrap().unwrap();
        let start = Cursor::at_interval(&layout, Bits::new(&bytes, headers.at), 0);
        let parts = part::read_parts(&layout, &bytes, headers.at, 4);
        let joined = join::join(&layout, parts, start).unwrap();
        let in_parts = joined.runs.iter().filter(|run| run.part < 4);
        let used: usize = in_parts.map(|run| run.count).sum();
        assert!(used > layout.mcus * 9 / 10, "{used} of {}", layout.mcus);
    }

    /// A file that is damaged for the check of full-size decoding is not decoded here, and the other way round.
    #[test]
    fn damage_is_found_as_by_the_check() {
        let whole = golden("restart");
        let structure = JpegStructure::read(&whole).unwrap();
        let scan = whole
            .windows(2)
            .position(|pair| pair == [0xFF, 0xDA])
            .unwrap()
            + 14;
        let mut noise = 7u32;
        let mut undamaged = 0;
        for _ in 0..600 {
            let mut next = |below: usize| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (noise >> 8) as usize % below
            };
            let mut bytes = whole.clone();
            let at = scan + next(whole.len() - scan - 40);
            match next(3) {
                0 => bytes[at] ^= 1 << next(8),
                1 => drop(bytes.drain(at..at + 1 + next(30))),
                _ => bytes[at..at + 20].fill(0),
            }
            let expected = crate::scan::check(&bytes, &structure.frame).is_none();
            undamaged += usize::from(expected);
            for part_count in [1, 3] {
                let found = decoded(&bytes, Reduction::Eighth, part_count).is_ok();
                assert_eq!(found, expected);
            }
        }
        assert!((50..550).contains(&undamaged), "{undamaged}");
    }
}
