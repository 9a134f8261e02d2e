//! How the samples of a track are coded: its sample entry (`stsd`; ISO/IEC 14496-12, 8.5.2, and 14496-15).

use crate::colour::ColourDescription;
use crate::error::Fault;
use crate::fields::{Fields, boxes, find};
use crate::pixel_aspect::PixelAspect;

/// Bytes of a visual sample entry before its boxes.
const ENTRY_BYTES: usize = 78;

/// A standard of video coding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Codec {
    H264,
    H265,
}

/// See the module.
pub(crate) struct SampleEntry {
    pub codec: Codec,
    pub parameter_sets: Vec<Vec<u8>>,
    pub nal_length_bytes: usize,
    pub colour: Option<ColourDescription>,
    pub aspect: Option<PixelAspect>,
}

impl SampleEntry {
    pub(crate) fn read(stsd: &[u8]) -> Result<Self, Fault> {
        let entries = stsd.get(8..).unwrap_or_default();
        let mut entries = boxes(entries);
        let entry = entries
            .next()
            .ok_or_else(|| Fault::damaged("its index does not say how the video is coded"))?;
        if entries.next().is_some() {
            return Err(Fault::Unsupported(
                "a video whose coding changes on the way".to_owned(),
            ));
        }
        let codec = match &entry.kind {
            b"avc1" | b"avc3" => Codec::H264,
            b"hvc1" | b"hev1" | b"dvh1" | b"dvhe" => Codec::H265,
            other => {
                let name = String::from_utf8_lossy(other);
                return Err(Fault::Unsupported(format!("video of the kind `{name}`")));
            }
        };
        let inner = entry.body.get(ENTRY_BYTES..).unwrap_or_default();
        let (name, configuration) = match codec {
            Codec::H264 => ("avcC", find(inner, b"avcC").and_then(avc_configuration)),
            Codec::H265 => ("hvcC", find(inner, b"hvcC").and_then(hevc_configuration)),
        };
        let (nal_length_bytes, parameter_sets) = configuration.ok_or_else(|| {
            Fault::damaged(format!(
                "the decoder's settings (`{name}`) are missing from its index or are damaged"
            ))
        })?;
        Ok(Self {
            codec,
            parameter_sets,
            nal_length_bytes,
            colour: find(inner, b"colr").and_then(colour),
            aspect: find(inner, b"pasp").and_then(aspect),
        })
    }
}

/// ITU-T H.264: 32 SPS and 256 PPS; H.265 has fewer, and other units beside them.
const MAX_PARAMETER_SETS: usize = 512;
/// Size of all parameter sets together: each start of decoding reads them. Those of cameras have some hundred bytes.
const MAX_PARAMETER_BYTES: usize = 64 << 10;

/// Length of the NAL units' lengths, and parameter sets.
type Configuration = (usize, Vec<Vec<u8>>);

/// `None` if the table ends early or has more than a stream can use.
fn nal_units(fields: &mut Fields<'_>, count: usize, sets: &mut Vec<Vec<u8>>) -> Option<()> {
    for _ in 0..count {
        let bytes = fields.u16()?;
        sets.push(fields.take(usize::from(bytes))?.to_vec());
        let all_bytes: usize = sets.iter().map(Vec::len).sum();
        if sets.len() > MAX_PARAMETER_SETS || all_bytes > MAX_PARAMETER_BYTES {
            return None;
        }
    }
    Some(())
}

/// ISO/IEC 14496-15, 5.3.3.1.
fn avc_configuration(avcc: &[u8]) -> Option<Configuration> {
    let mut fields = Fields(avcc);
    fields.take(4)?;
    let length_bytes = usize::from(fields.u8()? & 3) + 1;
    let mut sets = Vec::new();
    let count = fields.u8()? & 0x1f;
    nal_units(&mut fields, usize::from(count), &mut sets)?;
    let count = fields.u8()?;
    nal_units(&mut fields, usize::from(count), &mut sets)?;
    Some((length_bytes, sets))
}

/// ISO/IEC 14496-15, 8.3.3.1.
fn hevc_configuration(hvcc: &[u8]) -> Option<Configuration> {
    let mut fields = Fields(hvcc);
    fields.take(21)?;
    let length_bytes = usize::from(fields.u8()? & 3) + 1;
    let mut sets = Vec::new();
    for _ in 0..fields.u8()? {
        fields.u8()?;
        let count = fields.u16()?;
        nal_units(&mut fields, usize::from(count), &mut sets)?;
    }
    Some((length_bytes, sets))
}

/// `pasp` of ISO/IEC 14496-12, 12.1.4.
fn aspect(pasp: &[u8]) -> Option<PixelAspect> {
    let mut fields = Fields(pasp);
    PixelAspect::new(fields.u32()?, fields.u32()?)
}

/// `colr` of ISO/IEC 14496-12, 12.1.5 (`nclx`) and of QuickTime (`nclc`).
fn colour(colr: &[u8]) -> Option<ColourDescription> {
    let mut fields = Fields(colr);
    let kind: [u8; 4] = fields.array()?;
    if kind != *b"nclx" && kind != *b"nclc" {
        return None;
    }
    fields.take(4)?;
    let matrix = fields.u16()?;
    let is_full_range = kind == *b"nclx" && fields.u8()? & 0x80 != 0;
    Some(ColourDescription {
        matrix: u8::try_from(matrix).ok(),
        is_full_range,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `avcC` of so many SPS of so many bytes, and no PPS.
    fn avcc(count: u8, bytes: u16) -> Vec<u8> {
        let mut avcc = vec![1, 100, 0, 31, 0xff, 0xe0 | count];
        for _ in 0..count {
            avcc.extend(bytes.to_be_bytes());
            avcc.extend(vec![0x67; usize::from(bytes)]);
        }
        avcc.push(0);
        avcc
    }

    #[test]
    fn parameter_sets_are_read_unless_they_are_more_than_a_stream_uses() {
        let (length_bytes, sets) = avc_configuration(&avcc(3, 20)).unwrap();
        assert_eq!((length_bytes, sets.len()), (4, 3));
        assert!(avc_configuration(&avcc(1, 60_000)).is_some());
        assert!(avc_configuration(&avcc(31, 60_000)).is_none());
        // Thousands of empty ones, each with a vector of its own.
        let mut hvcc = vec![0; 22];
        hvcc.extend([1, 0x20]);
        hvcc.extend(60_000_u16.to_be_bytes());
        hvcc.extend(vec![0; 120_000]);
        assert!(hevc_configuration(&hvcc).is_none());
    }
}
