//! Structure of a JPEG file: its size, and whether it is complete and supported.

use std::path::Path;

use crate::container::JpegSegments;
use crate::error::PhotoError;

/// Frame header and position of the first scan (ITU-T T.81, annex B).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct JpegStructure {
    /// Width and height, px.
    pub size_px: (u32, u32),
    /// Offset of the first scan's entropy-coded data.
    scan_at: usize,
}

/// A coded block takes at least two bits, so a byte cannot hold more than four blocks of 64 px in the luminance, nor
/// more than sixteen where one chrominance block serves four (kept generous: end-of-band runs of progressive files).
const MAX_PIXELS_PER_BYTE: u64 = 64 * 256;

impl JpegStructure {
    /// Reads the segments up to the first scan.
    pub(crate) fn read(path: &Path, bytes: &[u8]) -> Result<Self, PhotoError> {
        let mut size_px = None;
        let mut segments = JpegSegments::new(bytes);
        while let Some((marker, body)) = segments.next() {
            match marker {
                // SOF0 to SOF15 without DHT (C4), JPG (C8) and DAC (CC).
                0xC0..=0xCF if !matches!(marker, 0xC4 | 0xC8 | 0xCC) => {
                    let Some(&[precision, h1, h0, w1, w0, ..]) = body.first_chunk::<6>() else {
                        break;
                    };
                    if precision != 8 || marker > 0xC2 {
                        return Err(PhotoError::Unsupported {
                            path: path.into(),
                            found: format!(
                                "a JPEG with {precision} bits per sample and frame type SOF{}",
                                marker - 0xC0
                            ),
                        });
                    }
                    size_px = Some((
                        u32::from(u16::from_be_bytes([w1, w0])),
                        u32::from(u16::from_be_bytes([h1, h0])),
                    ));
                }
                0xDA => {
                    let Some(size_px) = size_px else { break };
                    return Ok(Self {
                        size_px,
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
            Err(PhotoError::Truncated {
                path: path.into(),
                detail: format!("the file of {} bytes ends within the headers", bytes.len()),
            })
        } else {
            Err(PhotoError::Corrupt {
                path: path.into(),
                detail: format!("no JPEG marker at byte {}", segments.position),
            })
        }
    }

    /// Returns an error if the coded data end before the end-of-image marker. Decoders fill missing parts with grey, which would
    /// disturb matching.
    pub(crate) fn check_complete(&self, path: &Path, bytes: &[u8]) -> Result<(), PhotoError> {
        let truncated = |detail: String| PhotoError::Truncated {
            path: path.into(),
            detail,
        };
        let pixels = u64::from(self.size_px.0) * u64::from(self.size_px.1);
        if pixels > bytes.len() as u64 * MAX_PIXELS_PER_BYTE {
            return Err(truncated(format!(
                "{} bytes cannot hold {} x {} px",
                bytes.len(),
                self.size_px.0,
                self.size_px.1
            )));
        }
        if bytes.ends_with(&[0xFF, 0xD9]) || self.has_end_marker(bytes) {
            return Ok(());
        }
        Err(truncated(format!(
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
