//! JPEG pictures one after the other in a stream of bytes, as cameras and `ffmpeg -f image2pipe` write them.

use std::io::{self, BufRead};

/// A picture larger than this is not one, bytes.
const MOST_BYTES: usize = 256 << 20;

/// Splits a stream into pictures.
pub struct JpegStream<R> {
    input: R,
}

impl<R: BufRead> JpegStream<R> {
    /// Pictures from `input`.
    pub fn new(input: R) -> Self {
        Self { input }
    }

    /// The bytes of the next picture: from its start to its end marker (ITU-T T.81, annex B). What stands between pictures is
    /// skipped. `None` at the end of the stream, also if it ends within a picture, which gets a warning.
    ///
    /// # Errors
    /// The stream cannot be read, or holds a picture that does not end.
    pub fn next_picture(&mut self) -> io::Result<Option<Vec<u8>>> {
        if !self.find_start()? {
            return Ok(None);
        }
        let mut picture = vec![0xff, 0xd8];
        match self.read_to_end_marker(&mut picture) {
            Ok(()) => Ok(Some(picture)),
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                tracing::warn!("the stream ends within a picture; its last frame is left out");
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Reads up to and with the next start of a picture.
    fn find_start(&mut self) -> io::Result<bool> {
        let mut before = 0;
        loop {
            let mut byte = [0];
            if self.input.read(&mut byte)? == 0 {
                return Ok(false);
            }
            if before == 0xff && byte[0] == 0xd8 {
                return Ok(true);
            }
            before = byte[0];
        }
    }

    fn read_to_end_marker(&mut self, picture: &mut Vec<u8>) -> io::Result<()> {
        let mut marker = self.marker(picture)?;
        loop {
            match marker {
                0xd9 => return Ok(()),
                // Markers without content.
                0x01 | 0xd0..=0xd7 => marker = self.marker(picture)?,
                0xda => {
                    self.segment(picture)?;
                    marker = self.scan(picture)?;
                }
                _ => {
                    self.segment(picture)?;
                    marker = self.marker(picture)?;
                }
            }
        }
    }

    /// A marker's code; fill bytes may stand before it.
    fn marker(&mut self, picture: &mut Vec<u8>) -> io::Result<u8> {
        if self.byte(picture)? != 0xff {
            return Err(io::Error::other(
                "expected JPEG pictures one after the other; a picture is damaged",
            ));
        }
        loop {
            let code = self.byte(picture)?;
            if code != 0xff {
                return Ok(code);
            }
        }
    }

    /// A segment's length and content.
    fn segment(&mut self, picture: &mut Vec<u8>) -> io::Result<()> {
        let length = u16::from_be_bytes([self.byte(picture)?, self.byte(picture)?]);
        let at = picture.len();
        picture.resize(at + usize::from(length.saturating_sub(2)), 0);
        self.input.read_exact(&mut picture[at..])
    }

    /// Entropy-coded data; gives the marker behind them.
    fn scan(&mut self, picture: &mut Vec<u8>) -> io::Result<u8> {
        loop {
            let mut taken = 0;
            let available = self.input.fill_buf()?;
            if available.is_empty() {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            let end = available.iter().position(|&byte| byte == 0xff);
            taken += end.unwrap_or(available.len());
            picture.extend_from_slice(&available[..taken]);
            self.input.consume(taken);
            if picture.len() > MOST_BYTES {
                return Err(io::Error::other(
                    "a picture of the stream does not end within 256 MiB",
                ));
            }
            if end.is_some() {
                match self.marker(picture)? {
                    // A byte 0xff of the data, and restart markers.
                    0x00 | 0xd0..=0xd7 => {}
                    code => return Ok(code),
                }
            }
        }
    }

    fn byte(&mut self, picture: &mut Vec<u8>) -> io::Result<u8> {
        let mut byte = [0];
        self.input.read_exact(&mut byte)?;
        picture.push(byte[0]);
        Ok(byte[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ExtendedColorType, RgbImage, codecs::jpeg::JpegEncoder};

    fn jpeg(seed: u8) -> Vec<u8> {
        let picture = RgbImage::from_fn(64, 48, |x, y| {
            image::Rgb([(x * 7) as u8 ^ seed, (y * 13) as u8, (x * y) as u8])
        });
        let mut bytes = Vec::new();
        JpegEncoder::new_with_quality(&mut bytes, 95)
            .encode(&picture, 64, 48, ExtendedColorType::Rgb8)
            .unwrap();
        bytes
    }

    /// A thumbnail in the metadata has an end marker of its own.
    fn with_thumbnail(seed: u8) -> Vec<u8> {
        let (outer, inner) = (jpeg(seed), jpeg(200));
        let mut bytes = outer[..2].to_vec();
        bytes.extend([0xff, 0xe1]);
        bytes.extend(((inner.len() + 2) as u16).to_be_bytes());
        bytes.extend(&inner);
        bytes.extend(&outer[2..]);
        bytes
    }

    #[test]
    fn pictures_come_out_as_they_went_in() {
        let pictures = [jpeg(1), with_thumbnail(2), jpeg(3)];
        let mut stream = pictures[0].clone();
        stream.extend(b"between\xff\x00");
        stream.extend(&pictures[1]);
        stream.extend(&pictures[2]);
        // Small reads split every marker.
        for capacity in [1, 7, 4096] {
            let reader = io::BufReader::with_capacity(capacity, stream.as_slice());
            let mut split = JpegStream::new(reader);
            for picture in &pictures {
                assert_eq!(split.next_picture().unwrap().as_ref(), Some(picture));
            }
            assert_eq!(split.next_picture().unwrap(), None);
        }
    }

    #[test]
    fn a_stream_that_breaks_off_ends() {
        let picture = jpeg(1);
        for end in 0..picture.len() {
            let mut split = JpegStream::new(&picture[..end]);
            assert_eq!(split.next_picture().unwrap(), None, "{end}");
        }
    }

    #[test]
    fn what_is_no_picture_is_an_error_or_nothing() {
        assert!(
            JpegStream::new(&b"\xff\xd8hello"[..])
                .next_picture()
                .is_err()
        );
        assert_eq!(JpegStream::new(&b"hello"[..]).next_picture().unwrap(), None);
    }
}
