//! The coded frames of a file.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::PathBuf;

use crate::decoder::{Decoder, DecoderSettings};
use crate::error::{Fault, VideoError};
use crate::movie::Movie;
use crate::pixel_aspect::PixelAspect;

/// A coded frame is in memory in so many copies while it is decoded.
const SAMPLE_COPIES: u64 = 4;

/// Reads coded frames from the file.
#[derive(Debug)]
pub(crate) struct SampleSource {
    pub path: PathBuf,
    file: File,
    pub limit_bytes: u64,
    /// Of the last sample.
    bytes: Vec<u8>,
}

impl SampleSource {
    pub(crate) fn new(path: PathBuf, file: File, limit_bytes: u64) -> Self {
        Self {
            path,
            file,
            limit_bytes,
            bytes: Vec::new(),
        }
    }

    /// The bytes of a sample, which is in the file.
    pub(crate) fn read(&mut self, movie: &Movie, sample: usize) -> Result<&[u8], Fault> {
        let sample = movie
            .samples
            .get(sample)
            .ok_or_else(|| Fault::damaged("the index ends too early"))?;
        let needed_bytes = SAMPLE_COPIES * u64::from(sample.bytes);
        if needed_bytes > self.limit_bytes {
            let what = "a coded frame".to_owned();
            return Err(Fault::TooLarge { what, needed_bytes });
        }
        self.bytes.resize(sample.bytes as usize, 0);
        self.file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut self.bytes))
            .map_err(|error| Fault::damaged(format!("the file cannot be read there: {error}")))?;
        Ok(&self.bytes)
    }

    pub(crate) fn settings(&self, movie: &Movie) -> DecoderSettings {
        DecoderSettings {
            codec: movie.codec,
            parameter_sets: movie.parameter_sets.clone(),
            nal_length_bytes: movie.nal_length_bytes,
            colour: movie.colour,
            aspect: movie.aspect,
            limit_bytes: self.limit_bytes,
        }
    }

    /// Decodes the first frame that decoding can start at, and gives the size of its picture, and how wide its pixels were if they
    /// were no squares. One that is damaged says nothing of the others.
    pub(crate) fn try_first(
        &mut self,
        movie: &Movie,
    ) -> Result<((u32, u32), Option<PixelAspect>), VideoError> {
        let (path, limit_bytes) = (self.path.clone(), self.limit_bytes);
        let named = |fault: Fault| fault.of(&path, limit_bytes);
        let mut decoder = Decoder::new(self.settings(movie)).map_err(named)?;
        let start = movie.samples.iter().position(|sample| sample.is_sync);
        let start = start
            .ok_or_else(|| named(Fault::damaged("decoding can start at none of its frames")))?;
        let mut pictures = Vec::new();
        let fed = match self.read(movie, start) {
            Ok(bytes) => decoder.feed(start, bytes, true, &mut pictures),
            Err(fault) => Err(fault),
        };
        match fed {
            Err(Fault::Damaged(_)) if decoder.coded_size_px().is_some() => {}
            other => other.map_err(named)?,
        }
        decoder.flush(&mut pictures);
        let picture = pictures.first().map(|first| decoder.rgb(&first.picture));
        let size_px = if let Some(Ok(picture)) = picture {
            movie.rotation.upright(picture).dimensions()
        } else {
            let (width, height) = decoder.coded_size_px().unwrap_or_default();
            let side = |px: u64| u32::try_from(px).unwrap_or(u32::MAX);
            (side(width), side(height))
        };
        Ok((size_px, decoder.aspect()))
    }
}
