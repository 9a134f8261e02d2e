//! The segments of a JPEG file.

/// The segments of a JPEG file up to the first scan, as marker and body.
#[derive(Debug, Clone)]
pub struct JpegSegments<'a> {
    bytes: &'a [u8],
    /// Offset of the next marker.
    pub(crate) position: usize,
    ended: bool,
}

impl<'a> JpegSegments<'a> {
    /// Begins behind the first marker of a file.
    #[must_use]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            position: 2,
            ended: false,
        }
    }
}

impl<'a> Iterator for JpegSegments<'a> {
    type Item = (u8, &'a [u8]);

    /// The last item is the header of the first scan (0xDA); `position` then points at its entropy-coded data.
    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        loop {
            if *self.bytes.get(self.position)? != 0xFF {
                return None;
            }
            // Any number of 0xFF may precede a marker (T.81, B.1.1.2).
            while *self.bytes.get(self.position + 1)? == 0xFF {
                self.position += 1;
            }
            let marker = self.bytes[self.position + 1];
            if matches!(marker, 0x01 | 0xD0..=0xD8) {
                self.position += 2;
                continue;
            }
            if marker == 0xD9 || marker == 0 {
                return None;
            }
            let length = self.bytes.get(self.position + 2..)?.first_chunk::<2>()?;
            let length = usize::from(u16::from_be_bytes(*length));
            let body = self
                .bytes
                .get(self.position + 4..self.position + 2 + length.max(2))?;
            self.position += 2 + length.max(2);
            self.ended = marker == 0xDA;
            return Some((marker, body));
        }
    }
}
