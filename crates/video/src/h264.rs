//! H.264: the sequence parameter set (ITU-T H.264, 7.3.2.1.1 and E.1.1), and what a NAL unit is.

use rusty_h265::bits::{BitReader, OutOfData};
// Both standards escape NAL units and code numbers in the same way.
use rusty_h265::nal::unescape;

use crate::colour::ColourDescription;
use crate::pixel_aspect::PixelAspect;
use crate::stream_size::StreamSize;

/// Profiles whose parameter sets state chroma format, bit depths and scaling lists.
const HIGH_PROFILES: [u32; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];
/// `aspect_ratio_idc` that is followed by two numbers.
const EXTENDED_SAR: u32 = 255;
/// Pictures beside those that are referenced: the one being decoded and copies for output.
const MORE_PICTURES: u64 = 4;
/// Measured: samples with their margin, motion vectors, and what deblocking needs.
const BYTES_PER_PX: u64 = 4;

/// `nal_unit_type`.
pub(crate) fn nal_type(nal: &[u8]) -> u8 {
    nal.first().map_or(0, |first| first & 0x1f)
}

pub(crate) fn is_parameter_set(nal: &[u8]) -> bool {
    nal_type(nal) == 7
}

/// Whether the unit is a slice of a picture that decoding can start at.
pub(crate) fn is_start(nal: &[u8]) -> bool {
    nal_type(nal) == 5
}

/// Whether the unit is a slice of a picture that no other one is predicted from.
pub(crate) fn is_unreferenced_slice(nal: &[u8]) -> bool {
    nal_type(nal) == 1 && nal.first().is_some_and(|first| first & 0x60 == 0)
}

pub(crate) fn is_slice(nal: &[u8]) -> bool {
    (1..=5).contains(&nal_type(nal))
}

/// Reads a sequence parameter set.
pub(crate) fn stream_size(nal: &[u8]) -> Result<StreamSize, OutOfData> {
    let unescaped = unescape(nal.get(1..).ok_or(OutOfData)?);
    let mut bits = BitReader::new(&unescaped.data);
    let profile = bits.read_bits(8)?;
    bits.skip_bits(16)?;
    bits.read_ue()?; // seq_parameter_set_id
    if HIGH_PROFILES.contains(&profile) {
        skip_high_profile(&mut bits)?;
    }
    bits.read_ue()?; // log2_max_frame_num_minus4
    match bits.read_ue()? {
        0 => {
            bits.read_ue()?;
        }
        1 => {
            bits.skip_bits(1)?;
            bits.read_se()?;
            bits.read_se()?;
            for _ in 0..bits.read_ue()?.min(255) {
                bits.read_se()?;
            }
        }
        _ => {}
    }
    let references = bits.read_ue()?;
    bits.skip_bits(1)?;
    let width = 16 * (u64::from(bits.read_ue()?) + 1);
    let map_units = u64::from(bits.read_ue()?) + 1;
    let is_progressive = bits.read_flag()?;
    if !is_progressive {
        bits.skip_bits(1)?;
    }
    bits.skip_bits(1)?;
    let frame_height = if is_progressive { 1 } else { 2 };
    let mut hidden_px = (0, 0);
    if bits.read_flag()? {
        let [left, _, top, _] = [
            bits.read_ue()?,
            bits.read_ue()?,
            bits.read_ue()?,
            bits.read_ue()?,
        ];
        // In units of a chroma sample of 4:2:0. The decoder crops at the right and at the bottom alone.
        hidden_px = (2 * left as usize, 2 * frame_height * top as usize);
    }
    // What follows are hints: a set that ends in them is used without.
    let mut usability = Usability::default();
    usability.read(&mut bits).unwrap_or(());
    Ok(StreamSize {
        width,
        height: 16 * map_units * frame_height as u64,
        hidden_px,
        pictures: u64::from(references.min(16)) + MORE_PICTURES,
        bytes_per_px: BYTES_PER_PX,
        colour: usability.colour,
        aspect: usability.aspect,
    })
}

fn skip_high_profile(bits: &mut BitReader<'_>) -> Result<(), OutOfData> {
    let chroma_format = bits.read_ue()?;
    if chroma_format == 3 {
        bits.skip_bits(1)?;
    }
    bits.read_ue()?; // bit depths
    bits.read_ue()?;
    bits.skip_bits(1)?;
    if bits.read_flag()? {
        for list in 0..if chroma_format == 3 { 12 } else { 8 } {
            if bits.read_flag()? {
                skip_scaling_list(bits, if list < 6 { 16 } else { 64 })?;
            }
        }
    }
    Ok(())
}

/// 7.3.2.1.1.1.
fn skip_scaling_list(bits: &mut BitReader<'_>, count: usize) -> Result<(), OutOfData> {
    let (mut last, mut next) = (8, 8);
    for _ in 0..count {
        if next != 0 {
            next = (last + bits.read_se()?).rem_euclid(256);
        }
        if next != 0 {
            last = next;
        }
    }
    Ok(())
}

/// What the video usability information (E.1.1) states.
#[derive(Default)]
struct Usability {
    aspect: Option<PixelAspect>,
    colour: Option<ColourDescription>,
}

impl Usability {
    fn read(&mut self, bits: &mut BitReader<'_>) -> Result<(), OutOfData> {
        if !bits.read_flag()? {
            return Ok(());
        }
        if bits.read_flag()? {
            self.aspect = match bits.read_bits(8)? {
                EXTENDED_SAR => PixelAspect::new(bits.read_bits(16)?, bits.read_bits(16)?),
                number => PixelAspect::of_number(number),
            };
        }
        if bits.read_flag()? {
            bits.skip_bits(1)?;
        }
        if !bits.read_flag()? {
            return Ok(());
        }
        bits.skip_bits(3)?;
        let is_full_range = bits.read_flag()?;
        let mut matrix = None;
        if bits.read_flag()? {
            bits.skip_bits(16)?;
            matrix = u8::try_from(bits.read_bits(8)?).ok();
        }
        self.colour = Some(ColourDescription {
            matrix,
            is_full_range,
        });
        Ok(())
    }
}
