//! H.265: the sequence parameter set, and what a NAL unit is (ITU-T H.265, 7.3 and 7.4.2.2).

use rusty_h265::bits::BitReader;
use rusty_h265::nal::{NalHeader, NalType, unescape};
use rusty_h265::ps::{Sps, parse_sps, parse_st_ref_pic_set};

use crate::colour::ColourDescription;
use crate::pixel_aspect::PixelAspect;
use crate::stream_size::StreamSize;

/// Pictures beside those of the decoded picture buffer: the one being decoded, those that wait for output, and those that the
/// decoder keeps to use their memory again.
const MORE_PICTURES: u64 = 8;
/// Samples have 16 bits; motion, and what the filters need.
const BYTES_PER_PX: u64 = 5;

pub(crate) fn is_parameter_set(nal: &[u8]) -> bool {
    NalHeader::parse(nal).is_some_and(|header| matches!(header.nal_type, NalType::Sps))
}

/// Whether the unit is a slice of a picture that decoding can start at.
pub(crate) fn is_start(nal: &[u8]) -> bool {
    NalHeader::parse(nal).is_some_and(|header| header.nal_type.is_irap())
}

/// Whether the unit is a slice of a picture that no other one is predicted from, in a stream of one temporal layer.
pub(crate) fn is_unreferenced_slice(nal: &[u8]) -> bool {
    NalHeader::parse(nal)
        .is_some_and(|header| header.temporal_id == 0 && header.nal_type.is_sub_layer_non_ref())
}

pub(crate) fn is_slice(nal: &[u8]) -> bool {
    NalHeader::parse(nal).is_some_and(|header| header.nal_type.is_vcl())
}

/// Reads a sequence parameter set, and whether the stream has several temporal layers.
pub(crate) fn stream_size(nal: &[u8]) -> Result<(StreamSize, bool), rusty_h265::Error> {
    let unescaped = unescape(nal.get(2..).unwrap_or_default());
    let set = parse_sps(&unescaped.data)?;
    let layers = usize::from(set.max_sub_layers_minus1);
    let kept = set
        .ordering
        .get(layers)
        .map_or(0, |ordering| ordering.max_dec_pic_buffering_minus1);
    let of_vui = set.vui.as_ref().and_then(|vui| {
        let number = aspect_ratio_idc(&unescaped.data, &set).unwrap_or(None);
        PixelAspect::new(vui.sar_width.into(), vui.sar_height.into())
            .or(number.and_then(PixelAspect::of_number))
    });
    let size = StreamSize {
        width: u64::from(set.width),
        height: u64::from(set.height),
        hidden_px: (0, 0),
        pictures: u64::from(kept.min(16)) + 1 + MORE_PICTURES,
        bytes_per_px: BYTES_PER_PX,
        aspect: of_vui,
        colour: set.vui.map(|vui| ColourDescription {
            // 0 stands for no statement as well as for RGB, which is not decoded here.
            matrix: Some(vui.matrix_coeffs).filter(|&matrix| matrix != 0),
            is_full_range: vui.video_full_range_flag,
        }),
    };
    Ok((size, layers > 0))
}

/// `aspect_ratio_idc` of a parameter set that the decoder has read, whose parser gives only the numbers after 255 (7.3.2.2.1, E.2.1).
fn aspect_ratio_idc(data: &[u8], set: &Sps) -> Result<Option<u32>, rusty_h265::Error> {
    let mut bits = BitReader::new(data);
    let sub_layers = u32::from(set.max_sub_layers_minus1);
    bits.skip_bits(8)?;
    skip_profile(&mut bits, sub_layers)?;
    bits.read_ue()?; // sps_seq_parameter_set_id
    if bits.read_ue()? == 3 {
        bits.skip_bits(1)?;
    }
    skip_numbers(&mut bits, 2)?; // size
    if bits.read_flag()? {
        skip_numbers(&mut bits, 4)?; // conformance window
    }
    skip_numbers(&mut bits, 3)?; // bit depths, log2_max_pic_order_cnt_lsb_minus4
    let of_all_layers = bits.read_flag()?;
    let orderings = if of_all_layers { sub_layers + 1 } else { 1 };
    skip_numbers(&mut bits, 3 * orderings)?;
    skip_numbers(&mut bits, 6)?; // block sizes and depths
    if bits.read_flag()? && bits.read_flag()? {
        skip_scaling_lists(&mut bits)?;
    }
    bits.skip_bits(2)?;
    if bits.read_flag()? {
        bits.skip_bits(8)?; // pulse code modulation
        skip_numbers(&mut bits, 2)?;
        bits.skip_bits(1)?;
    }
    bits.read_ue()?; // num_short_term_ref_pic_sets
    for number in 0..set.st_rps.len() {
        parse_st_ref_pic_set(&mut bits, number, &set.st_rps[..number], false)?;
    }
    if bits.read_flag()? {
        for _ in 0..bits.read_ue_max(32)? {
            bits.skip_bits(u32::from(set.log2_max_poc_lsb) + 1)?;
        }
    }
    bits.skip_bits(2)?;
    if bits.read_flag()? && bits.read_flag()? {
        return Ok(Some(bits.read_bits(8)?));
    }
    Ok(None)
}

fn skip_numbers(bits: &mut BitReader<'_>, count: u32) -> Result<(), rusty_h265::Error> {
    for _ in 0..count {
        bits.read_ue()?;
    }
    Ok(())
}

/// 7.3.3.
fn skip_profile(bits: &mut BitReader<'_>, sub_layers: u32) -> Result<(), rusty_h265::Error> {
    const PROFILE_BITS: u32 = 88;
    const LEVEL_BITS: u32 = 8;
    bits.skip_bits(PROFILE_BITS + LEVEL_BITS)?;
    let mut of_layers = 0;
    for _ in 0..sub_layers {
        of_layers += if bits.read_flag()? { PROFILE_BITS } else { 0 };
        of_layers += if bits.read_flag()? { LEVEL_BITS } else { 0 };
    }
    if sub_layers > 0 {
        bits.skip_bits(2 * (8 - sub_layers))?;
    }
    bits.skip_bits(of_layers)?;
    Ok(())
}

/// 7.3.4.
fn skip_scaling_lists(bits: &mut BitReader<'_>) -> Result<(), rusty_h265::Error> {
    for size in 0..4 {
        for _ in 0..if size == 3 { 2 } else { 6 } {
            if bits.read_flag()? {
                let start = u32::from(size > 1);
                for _ in 0..start + (16 << (2 * size)).min(64) {
                    bits.read_se()?;
                }
            } else {
                bits.read_ue()?;
            }
        }
    }
    Ok(())
}
