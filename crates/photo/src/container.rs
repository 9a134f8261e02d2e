//! Finds EXIF and XMP in JPEG, PNG, WebP and TIFF files.

use grimnet_jpeg::JpegSegments;

/// Raw metadata blocks of one file, other than XMP in EXIF.
#[derive(Debug, Default)]
pub(crate) struct Embedded {
    /// The TIFF structure of EXIF.
    pub exif: Option<Vec<u8>>,
    /// XMP packets, XML text.
    pub xmp: Vec<Vec<u8>>,
    /// Whether a PNG file has EXIF or XMP in texts that are not read: compressed, or ImageMagick's `Raw profile type`.
    pub has_unread_texts: bool,
}

/// Larger metadata blocks are ignored.
pub(crate) const MAX_BLOCK_BYTES: usize = 16 << 20;

const XMP_SIGNATURE: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
const EXIF_SIGNATURE: &[u8] = b"Exif\0\0";

impl Embedded {
    /// Finds the blocks. In a damaged container the blocks before the damage are found, in an unknown one none.
    pub(crate) fn find(bytes: &[u8]) -> Self {
        let mut found = Self::default();
        if bytes.starts_with(&[0xFF, 0xD8]) {
            found.find_in_jpeg(bytes);
        } else if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            found.find_in_png(bytes);
        } else if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WEBP") {
            found.find_in_webp(bytes);
        } else if bytes.starts_with(b"II*\0") || bytes.starts_with(b"MM\0*") {
            found.find_in_tiff(bytes);
        }
        found
    }

    /// APP1 segments before the first scan (EXIF 2.32 section 4.5; XMP part 3 section 1.1.3).
    fn find_in_jpeg(&mut self, bytes: &[u8]) {
        for (marker, body) in JpegSegments::new(bytes) {
            if marker != 0xE1 {
                continue;
            }
            if let Some(exif) = body.strip_prefix(EXIF_SIGNATURE) {
                self.exif.get_or_insert_with(|| exif.to_vec());
            } else if let Some(xmp) = body.strip_prefix(XMP_SIGNATURE) {
                self.xmp.push(xmp.to_vec());
            }
        }
    }

    /// `eXIf` and uncompressed `iTXt` chunks (PNG third edition, 11.3.4.5 and 11.3.3.4); other texts are only noted.
    fn find_in_png(&mut self, bytes: &[u8]) {
        let mut rest = bytes.get(8..).unwrap_or_default();
        while let Some((length, after)) = rest.split_first_chunk::<4>() {
            let length = u32::from_be_bytes(*length) as usize;
            let (Some(kind), Some(body)) = (after.get(..4), after.get(4..4 + length)) else {
                return;
            };
            match kind {
                b"eXIf" if length <= MAX_BLOCK_BYTES => self.exif = Some(body.to_vec()),
                b"iTXt" if length <= MAX_BLOCK_BYTES => {
                    // Keyword, NUL, compression flag and method, language, NUL, translated keyword, NUL, text.
                    if let Some(text) = body.strip_prefix(b"XML:com.adobe.xmp\0\0\0")
                        && let Some(text) = after_nul(text).and_then(after_nul)
                    {
                        self.xmp.push(text.to_vec());
                    } else if body.starts_with(b"XML:com.adobe.xmp\0\x01") {
                        self.has_unread_texts = true;
                    }
                }
                b"tEXt" | b"zTXt" => {
                    let profiles: [&[u8]; 3] = [
                        b"Raw profile type xmp\0",
                        b"Raw profile type exif\0",
                        b"Raw profile type APP1\0",
                    ];
                    self.has_unread_texts |= profiles.iter().any(|name| body.starts_with(name));
                }
                _ => {}
            }
            rest = after.get(8 + length..).unwrap_or_default();
        }
    }

    /// `EXIF` and `XMP ` chunks of the extended RIFF container.
    fn find_in_webp(&mut self, bytes: &[u8]) {
        let mut rest = bytes.get(12..).unwrap_or_default();
        while rest.len() >= 8 {
            let length = u32::from_le_bytes([rest[4], rest[5], rest[6], rest[7]]) as usize;
            let Some(body) = rest.get(8..8usize.saturating_add(length)) else {
                return;
            };
            if length <= MAX_BLOCK_BYTES {
                match &rest[..4] {
                    b"EXIF" => {
                        self.exif =
                            Some(body.strip_prefix(EXIF_SIGNATURE).unwrap_or(body).to_vec());
                    }
                    b"XMP " => self.xmp.push(body.to_vec()),
                    _ => {}
                }
            }
            rest = rest.get(8 + length + length % 2..).unwrap_or_default();
        }
    }

    /// A TIFF file is an EXIF structure itself. It is copied as far as its directories may reach: they are read by offset, so the
    /// whole file counts.
    fn find_in_tiff(&mut self, bytes: &[u8]) {
        self.exif = Some(bytes.to_vec());
    }
}

fn after_nul(bytes: &[u8]) -> Option<&[u8]> {
    let at = bytes.iter().position(|&b| b == 0)?;
    bytes.get(at + 1..)
}
