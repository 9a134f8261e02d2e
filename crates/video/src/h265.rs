//! H.265: the sequence parameter set, and what a NAL unit is (ITU-T H.265, 7.3 and 7.4.2.2).

use rusty_h265::nal::{NalHeader, NalType, unescape};
use rusty_h265::ps::parse_sps;

use crate::colour::ColourDescription;
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
    let size = StreamSize {
        width: u64::from(set.width),
        height: u64::from(set.height),
        pictures: u64::from(kept.min(16)) + 1 + MORE_PICTURES,
        bytes_per_px: BYTES_PER_PX,
        colour: set.vui.map(|vui| ColourDescription {
            // 0 stands for no statement as well as for RGB, which is not decoded here.
            matrix: Some(vui.matrix_coeffs).filter(|&matrix| matrix != 0),
            is_full_range: vui.video_full_range_flag,
        }),
    };
    Ok((size, layers > 0))
}
