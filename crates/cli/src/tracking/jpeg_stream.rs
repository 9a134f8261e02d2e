//! JPEG pictures one after the other in a stream of bytes, as cameras and `ffmpeg -f image2pipe` write them.

use std::io::{self, BufRead};

/// A picture larger than this is not one, bytes.
const MOST_BYTES: usize = 256 << 20;

/// Splits a stream into pictures.
pub struct JpegStream<R> {
    input: R,
    /// Whether the start marker of the next picture was read: within one that breaks off.
    is_started: bool,
}

/// Why the end of a picture is not found.
enum Broken {
    /// It is damaged.
    Damaged,
    /// The stream ends or cannot be read.
    Io(io::Error),
}

impl From<io::Error> for Broken {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl<R: BufRead> JpegStream<R> {
    /// Pictures from `input`.
    pub fn new(input: R) -> Self {
        Self {
            input,
            is_started: false,
        }
    }

    /// The bytes of the next picture: from its start to its end marker (ITU-T T.81, annex B). What stands between pictures is
    /// skipped. Of a picture that is damaged or breaks off, what was read of it; the next one begins at the next start marker. `None`
    /// at the end of the stream, also if it ends within a picture, which gets a warning.
    ///
    /// # Errors
    /// The stream cannot be read.
    pub fn next_picture(&mut self) -> io::Result<Option<Vec<u8>>> {
        if !std::mem::take(&mut self.is_started) && !self.find_start()? {
            return Ok(None);
        }
        let mut picture = vec![0xff, 0xd8];
        match self.read_to_end_marker(&mut picture) {
            Ok(()) | Err(Broken::Damaged) => Ok(Some(picture)),
            Err(Broken::Io(error)) if error.kind() == io::ErrorKind::UnexpectedEof => {
                tracing::warn!("the stream ends within a picture; its last frame is left out");
                Ok(None)
            }
            Err(Broken::Io(error)) => Err(error),
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

    fn read_to_end_marker(&mut self, picture: &mut Vec<u8>) -> Result<(), Broken> {
        let mut marker = self.marker(picture)?;
        loop {
            match marker {
                0xd9 => return Ok(()),
                // Markers without content.
                0x01 | 0xd0..=0xd7 => marker = self.marker(picture)?,
                // The start of another picture.
                0xd8 => {
                    picture.truncate(picture.len() - 2);
                    self.is_started = true;
                    return Err(Broken::Damaged);
                }
                // Reserved.
                0x00..=0xbf => return Err(Broken::Damaged),
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
    fn marker(&mut self, picture: &mut Vec<u8>) -> Result<u8, Broken> {
        if self.byte(picture)? != 0xff {
            return Err(Broken::Damaged);
        }
        loop {
            let code = self.byte(picture)?;
            if code != 0xff {
                return Ok(code);
            }
            // One of them is enough, or there may be more than memory holds.
            picture.pop();
        }
    }

    /// A segment's length and content.
    fn segment(&mut self, picture: &mut Vec<u8>) -> Result<(), Broken> {
        let length = u16::from_be_bytes([self.byte(picture)?, self.byte(picture)?]);
        let at = picture.len();
        picture.resize(at + usize::from(length.saturating_sub(2)), 0);
        Ok(self.input.read_exact(&mut picture[at..])?)
    }

    /// Entropy-coded data; gives the marker behind them.
    fn scan(&mut self, picture: &mut Vec<u8>) -> Result<u8, Broken> {
        loop {
            if picture.len() > MOST_BYTES {
                return Err(Broken::Damaged);
            }
            let available = self.input.fill_buf()?;
            if available.is_empty() {
                return Err(Broken::Io(io::ErrorKind::UnexpectedEof.into()));
            }
            let end = available.iter().position(|&byte| byte == 0xff);
            let taken = end.unwrap_or(available.len());
            picture.extend_from_slice(&available[..taken]);
            self.input.consume(taken);
            if end.is_some() {
                match self.marker(picture)? {
                    // A byte 0xff of the data, and restart markers.
                    0x00 | 0xd0..=0xd7 => {}
                    code => return Ok(code),
                }
            }
        }
    }

    fn byte(&mut self, picture: &mut Vec<u8>) -> Result<u8, Broken> {
        if picture.len() > MOST_BYTES {
            return Err(Broken::Damaged);
        }
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
    fn what_is_no_picture_is_nothing() {
        assert_eq!(JpegStream::new(&b"hello"[..]).next_picture().unwrap(), None);
        let mut split = JpegStream::new(&b"\xff\xd8hello"[..]);
        assert_eq!(
            split.next_picture().unwrap().as_deref(),
            Some(&b"\xff\xd8h"[..])
        );
        assert_eq!(split.next_picture().unwrap(), None);
    }

    #[test]
    fn the_picture_after_a_damaged_one_comes_out_whole() {
        let (whole, next) = (jpeg(1), jpeg(2));
        let header = whole.len() / 2;
        let mut reserved = whole.clone();
        reserved[header..header + 2].copy_from_slice(b"\xff\x05");
        for damaged in [&whole[..header], &whole[..30], &reserved, b"\xff\xd8hello"] {
            let stream = [damaged, &next, &next].concat();
            let mut split = JpegStream::new(stream.as_slice());
            let first = split.next_picture().unwrap().unwrap();
            assert!(image::load_from_memory(&first).is_err() || first.len() < whole.len());
            let mut last = None;
            while let Some(picture) = split.next_picture().unwrap() {
                last = Some(picture);
            }
            assert_eq!(last.as_ref(), Some(&next));
        }
    }

    #[test]
    fn fill_bytes_take_no_memory() {
        let stream = [&b"\xff\xd8"[..], &[0xff; 5000], &jpeg(1)[3..]].concat();
        let picture = JpegStream::new(stream.as_slice()).next_picture().unwrap();
        assert_eq!(picture, Some(jpeg(1)));
    }
}
