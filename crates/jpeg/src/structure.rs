//! Structure of a JPEG file: its size, and whether it is complete and supported.

use crate::error::JpegError;
use crate::segments::JpegSegments;

/// What the frame header states (ITU-T T.81, B.2.2).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Frame {
    /// Width and height, px.
    pub size_px: (u32, u32),
    /// Whether coefficients come in several scans (SOF2).
    pub is_progressive: bool,
    /// The colour components.
    pub components: Vec<FrameComponent>,
}

/// A colour component of a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct FrameComponent {
    /// Identifier, by which scans name it.
    pub id: u8,
    /// Horizontal sampling factor, 1 to 4.
    pub h: u32,
    /// Vertical sampling factor, 1 to 4.
    pub v: u32,
    /// Index of its quantisation table.
    pub quantisation: u8,
}

impl Frame {
    /// Reads the body of a frame header behind the sample precision; `None` if it is malformed.
    fn read(is_progressive: bool, size_px: (u32, u32), components: &[u8]) -> Option<Self> {
        let (&count, rest) = components.split_first()?;
        let listed = rest.get(..3 * usize::from(count))?;
        let components: Vec<FrameComponent> = listed
            .as_chunks::<3>()
            .0
            .iter()
            .map(|&[id, sampling, quantisation]| FrameComponent {
                id,
                h: u32::from(sampling >> 4),
                v: u32::from(sampling & 15),
                quantisation,
            })
            .collect();
        let are_valid = components
            .iter()
            .all(|c| (1..=4).contains(&c.h) && (1..=4).contains(&c.v) && c.quantisation < 4);
        (matches!(count, 1..=4) && are_valid).then_some(Self {
            size_px,
            is_progressive,
            components,
        })
    }

    /// Largest sampling factors, horizontal and vertical.
    pub(crate) fn max_sampling(&self) -> (u64, u64) {
        let largest = |of: fn(&FrameComponent) -> u32| {
            u64::from(self.components.iter().map(of).max().unwrap_or(1))
        };
        (largest(|c| c.h), largest(|c| c.v))
    }

    /// Number of MCUs of a scan of several components (A.2.3).
    pub(crate) fn mcus(&self) -> u64 {
        let (h, v) = self.max_sampling();
        let (width, height) = self.size_px;
        u64::from(width).div_ceil(8 * h) * u64::from(height).div_ceil(8 * v)
    }

    /// Number of blocks of a scan of one component (A.2.2).
    pub(crate) fn blocks(&self, component: &FrameComponent) -> u64 {
        let (h_max, v_max) = self.max_sampling();
        let side = |px: u32, factor: u32, largest: u64| {
            (u64::from(px) * u64::from(factor))
                .div_ceil(largest)
                .div_ceil(8)
        };
        let (width, height) = self.size_px;
        side(width, component.h, h_max) * side(height, component.v, v_max)
    }

    /// Whether the components have the names R, G and B, by which libjpeg and the decoder at full size know RGB without an Adobe
    /// segment.
    fn is_named_rgb(&self) -> bool {
        self.components.iter().map(|c| c.id).eq(*b"RGB")
    }

    /// Samples of all components for each pixel, at most: 3 without subsampling of the chrominance, 1.5 with one chrominance sample
    /// for four pixels.
    pub(crate) fn samples_per_px(&self) -> f64 {
        let (h_max, v_max) = self.max_sampling();
        let samples: u32 = self.components.iter().map(|c| c.h * c.v).sum();
        f64::from(samples) / (h_max * v_max) as f64
    }
}

/// Frame header and position of the first scan (ITU-T T.81, annex B).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct JpegStructure {
    /// The frame header.
    pub frame: Frame,
    /// Whether three components are not YCbCr: an Adobe segment (APP14) or their names say so.
    pub has_other_colours: bool,
    /// Number of components in the first scan.
    pub first_scan_components: usize,
    /// Offset of the first scan's entropy-coded data.
    scan_at: usize,
}

/// A coded block takes at least two bits, so a byte cannot hold more than four blocks of 64 px in the luminance, nor
/// more than sixteen where one chrominance block serves four (kept generous: end-of-band runs of progressive files).
const MAX_PIXELS_PER_BYTE: u64 = 64 * 256;

impl JpegStructure {
    /// Whether coefficients come in several scans.
    pub(crate) fn has_several_scans(&self) -> bool {
        self.frame.is_progressive || self.first_scan_components < self.frame.components.len()
    }

    /// Reads the segments up to the first scan.
    pub(crate) fn read(bytes: &[u8]) -> Result<Self, JpegError> {
        let mut frame = None;
        let mut has_other_colours = false;
        let mut segments = JpegSegments::new(bytes);
        while let Some((marker, body)) = segments.next() {
            match marker {
                // SOF0 to SOF15 without DHT (C4), JPG (C8) and DAC (CC).
                0xC0..=0xCF if !matches!(marker, 0xC4 | 0xC8 | 0xCC) => {
                    let Some(&[precision, h1, h0, w1, w0, ..]) = body.first_chunk::<6>() else {
                        break;
                    };
                    if precision != 8 || marker > 0xC2 {
                        return Err(JpegError::Unsupported(format!(
                            "a JPEG with {precision} bits per sample and frame type SOF{}",
                            marker - 0xC0
                        )));
                    }
                    let size_px = (
                        u32::from(u16::from_be_bytes([w1, w0])),
                        u32::from(u16::from_be_bytes([h1, h0])),
                    );
                    frame = Frame::read(marker == 0xC2, size_px, &body[5..]);
                    if frame.is_none() {
                        return Err(JpegError::Corrupt(
                            "the frame header states impossible components".into(),
                        ));
                    }
                }
                // "Adobe", version, flags, and 1 for YCbCr.
                0xEE if body.starts_with(b"Adobe") => has_other_colours = body.get(11) != Some(&1),
                0xDA => {
                    let Some(frame) = frame else { break };
                    return Ok(Self {
                        has_other_colours: has_other_colours || frame.is_named_rgb(),
                        frame,
                        first_scan_components: body.first().map_or(0, |&count| count.into()),
                        scan_at: segments.position,
                    });
                }
                _ => {}
            }
        }
        if bytes
            .get(segments.position)
            .is_none_or(|&byte| byte == 0xFF)
        {
            Err(JpegError::Truncated(format!(
                "the file of {} bytes ends within the headers",
                bytes.len()
            )))
        } else {
            Err(JpegError::Corrupt(format!(
                "no JPEG marker at byte {}",
                segments.position
            )))
        }
    }

    /// Returns an error if the coded data end before the end-of-image marker. Decoders fill missing parts with grey, which would
    /// disturb matching.
    pub(crate) fn check_complete(&self, bytes: &[u8]) -> Result<(), JpegError> {
        let (width_px, height_px) = self.frame.size_px;
        let pixels = u64::from(width_px) * u64::from(height_px);
        if pixels > bytes.len() as u64 * MAX_PIXELS_PER_BYTE {
            return Err(JpegError::Truncated(format!(
                "{} bytes cannot hold {width_px} x {height_px} px",
                bytes.len(),
            )));
        }
        if bytes.ends_with(&[0xFF, 0xD9]) || self.has_end_marker(bytes) {
            return Ok(());
        }
        Err(JpegError::Truncated(format!(
            "the file of {} bytes ends before the end-of-image marker",
            bytes.len()
        )))
    }

    /// Follows the scans to the end-of-image marker. Data after it (previews, panorama data) are ignored.
    fn has_end_marker(&self, bytes: &[u8]) -> bool {
        let mut at = self.scan_at;
        while let Some(found) = find_byte(0xFF, bytes.get(at..).unwrap_or_default()) {
            at += found + 1;
            match bytes.get(at) {
                None => return false,
                Some(0xD9) => return true,
                // A stuffed byte, a restart marker, a fill byte: still in the coded data.
                Some(0x00 | 0xD0..=0xD7 | 0xFF) => {}
                // Tables and the header of the next scan, with their length.
                Some(_) => {
                    let Some(length) = bytes.get(at + 1..).and_then(|b| b.first_chunk::<2>())
                    else {
                        return false;
                    };
                    at += 1 + usize::from(u16::from_be_bytes(*length));
                }
            }
        }
        false
    }
}

fn find_byte(byte: u8, bytes: &[u8]) -> Option<usize> {
    bytes.iter().position(|&b| b == byte)
}
