//! The frames of a video one after the other.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use image::RgbImage;

use crate::decoder::{Decoded, Decoder};
use crate::error::{Fault, VideoError};
use crate::movie::Movie;
use crate::sample_source::SampleSource;

/// Pictures that wait for others that are shown before them: as many as a decoded picture buffer holds (ITU-T H.264, A.3.1), and
/// one more. In a file whose times want more they come out of order.
const MAX_WAITING: usize = 17;

/// A frame of a video.
#[derive(Debug)]
pub struct VideoFrame {
    /// When it is shown, seconds from the beginning of the video.
    pub time_s: f64,
    /// The picture, upright; or why it cannot be decoded.
    pub picture: Result<RgbImage, VideoError>,
}

/// Decodes a video. See [`crate::Video::at_rate`].
pub struct VideoFrames {
    source: SampleSource,
    movie: Movie,
    decoder: Decoder,
    /// Place in the order of showing of each sample that is taken.
    places: HashMap<usize, usize>,
    /// Samples that are taken and not decoded yet.
    wanted: BTreeSet<usize>,
    /// Samples that are taken and decoded, whose pictures have not come out of the decoder.
    inside: BTreeSet<usize>,
    /// The next sample to decode.
    at: usize,
    /// The sample that a start was last looked for to reach.
    sought: Option<usize>,
    /// By place.
    ready: BTreeMap<usize, VideoFrame>,
    ready_bytes: u64,
    /// The place of the next frame.
    next_place: usize,
}

impl VideoFrames {
    pub(crate) fn new(
        source: SampleSource,
        movie: Movie,
        taken: Vec<usize>,
    ) -> Result<Self, VideoError> {
        let decoder = Decoder::new(source.settings(&movie))
            .map_err(|fault| fault.of(&source.path, source.limit_bytes))?;
        let places: HashMap<usize, usize> = taken
            .iter()
            .enumerate()
            .map(|(place, &sample)| (sample, place))
            .collect();
        Ok(Self {
            source,
            movie,
            decoder,
            places,
            wanted: taken.into_iter().collect(),
            inside: BTreeSet::new(),
            at: 0,
            sought: None,
            ready: BTreeMap::new(),
            ready_bytes: 0,
            next_place: 0,
        })
    }

    /// Decodes towards the next sample that is taken.
    fn advance(&mut self, target: usize) {
        // Once for each: looking again and again costs the square of the distance.
        if self.sought.replace(target) != Some(target) {
            let start = self.start_of(target);
            if start > self.at && self.can_start(start) {
                self.restart(start);
            }
        }
        let sample = self.at;
        let is_wanted = self.wanted.contains(&sample);
        let mut pictures = Vec::new();
        let fed = match self.source.read(&self.movie, sample) {
            Ok(bytes) => self.decoder.feed(sample, bytes, is_wanted, &mut pictures),
            Err(fault) => Err(fault),
        };
        self.at += 1;
        if self.wanted.remove(&sample) {
            self.inside.insert(sample);
        }
        self.keep(pictures);
        if let Err(fault) = fed {
            self.give_up(sample, &fault);
        } else if self.wanted.is_empty() {
            self.drain("it is predicted from a damaged part");
        }
    }

    /// The last sample that decoding can start at to reach `target` and what is taken after it: before it in the file, and not shown
    /// after it.
    fn start_of(&self, target: usize) -> usize {
        let samples = &self.movie.samples;
        let shown = samples[target].composition;
        let may_start = |sample: usize| sample < target || !self.has_leading(target);
        (self.at..=target)
            .rev()
            .find(|&sample| {
                samples[sample].is_sync && samples[sample].composition <= shown && may_start(sample)
            })
            .unwrap_or(self.at)
    }

    /// Whether a sample that is taken comes after this one in the file and is shown before it. In H.265 it may be predicted from the
    /// group before, without which it is lost.
    fn has_leading(&self, start: usize) -> bool {
        let samples = &self.movie.samples;
        let shown = samples[start].composition;
        (start + 1..samples.len())
            .take_while(|&next| samples[next].composition < shown)
            .any(|next| self.wanted.contains(&next))
    }

    fn can_start(&mut self, sample: usize) -> bool {
        match self.source.read(&self.movie, sample) {
            Ok(bytes) => self.decoder.is_start(bytes),
            Err(_) => false,
        }
    }

    /// Takes what the decoder still holds, and goes on at another sample.
    fn restart(&mut self, sample: usize) {
        self.drain("it is predicted from a damaged part");
        match Decoder::new(self.source.settings(&self.movie)) {
            Ok(decoder) => self.decoder = decoder,
            Err(fault) => tracing::debug!("the decoder did not start again: {fault}"),
        }
        self.at = sample;
    }

    /// Leaves out what cannot be decoded without the damaged `sample`: everything up to the next start.
    fn give_up(&mut self, sample: usize, fault: &Fault) {
        self.inside.remove(&sample);
        self.drain("it is predicted from a damaged part");
        let count = self.movie.samples.len();
        let next = (sample + 1..count)
            .find(|&next| self.movie.samples[next].is_sync && self.can_start(next))
            .unwrap_or(count);
        let mut lost: Vec<usize> = self.wanted.range(..next).copied().collect();
        if self.places.contains_key(&sample) {
            lost.push(sample);
        }
        for sample in lost {
            self.wanted.remove(&sample);
            self.fail(sample, fault);
        }
        if next < count {
            self.restart(next);
        }
        self.at = next;
    }

    /// Takes everything out of the decoder; what does not come is lost, for this reason.
    fn drain(&mut self, reason: &str) {
        let mut pictures = Vec::new();
        self.decoder.flush(&mut pictures);
        self.keep(pictures);
        for sample in std::mem::take(&mut self.inside) {
            self.fail(sample, &Fault::damaged(reason));
        }
    }

    fn keep(&mut self, pictures: Vec<Decoded>) {
        for Decoded { sample, picture } in pictures {
            if self.inside.remove(&sample) {
                match self.decoder.rgb(&picture) {
                    Ok(picture) => self.put(sample, Ok(self.movie.rotation.upright(picture))),
                    Err(fault) => self.fail(sample, &fault),
                }
            }
        }
    }

    fn fail(&mut self, sample: usize, fault: &Fault) {
        let error = VideoError::Frame {
            path: self.source.path.clone(),
            time_s: self.time_s(sample),
            detail: fault.to_string(),
        };
        self.put(sample, Err(error));
    }

    fn put(&mut self, sample: usize, picture: Result<RgbImage, VideoError>) {
        let time_s = self.time_s(sample);
        if let Some(&place) = self.places.get(&sample) {
            self.ready_bytes += bytes_of(&picture);
            self.ready.insert(place, VideoFrame { time_s, picture });
        }
    }

    fn time_s(&self, sample: usize) -> f64 {
        self.movie
            .shown_s
            .get(sample)
            .copied()
            .flatten()
            .unwrap_or(0.0)
    }

    /// The next frame in the order of showing, if it is there.
    fn take_ready(&mut self) -> Option<VideoFrame> {
        let (&place, _) = self.ready.first_key_value()?;
        let is_next = place <= self.next_place;
        let is_last = self.wanted.is_empty() && self.inside.is_empty();
        let is_full =
            self.ready.len() >= MAX_WAITING || self.ready_bytes > self.source.limit_bytes / 4;
        if !is_next && !is_last && !is_full {
            return None;
        }
        self.next_place = self.next_place.max(place + 1);
        let (_, frame) = self.ready.pop_first()?;
        self.ready_bytes -= bytes_of(&frame.picture);
        Some(frame)
    }
}

fn bytes_of(picture: &Result<RgbImage, VideoError>) -> u64 {
    picture
        .as_ref()
        .map_or(0, |picture| picture.as_raw().len() as u64)
}

impl Iterator for VideoFrames {
    type Item = VideoFrame;

    fn next(&mut self) -> Option<VideoFrame> {
        loop {
            if let Some(frame) = self.take_ready() {
                return Some(frame);
            }
            let target = self.wanted.first().copied()?;
            self.advance(target);
        }
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.wanted.len() + self.inside.len() + self.ready.len();
        (left, Some(left))
    }
}

impl ExactSizeIterator for VideoFrames {}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use grimnet_limits::PhotoLimits;

    use super::*;
    use crate::golden_tests::videos::golden;
    use crate::sample::Sample;

    #[test]
    fn a_start_is_looked_for_once_on_the_long_way_to_a_frame() {
        let path = golden("h264_b_frames.mp4");
        let mut file = File::open(&path).unwrap();
        let limits = PhotoLimits::DEFAULT;
        let mut movie = Movie::read(&path, &mut file, &limits).unwrap();
        // One frame that decoding can start at, and two million empty ones after it.
        movie.samples.truncate(1);
        movie.shown_s.truncate(1);
        let first = movie.samples[0];
        let last = 2_000_000;
        for number in 1..=last {
            movie.samples.push(Sample {
                bytes: 0,
                is_sync: false,
                composition: first.composition + number,
                ..first
            });
            movie.shown_s.push(Some(number as f64));
        }
        let source = SampleSource::new(path, file, limits.max_memory_bytes);
        let frames = VideoFrames::new(source, movie, vec![0, last as usize]).unwrap();
        let decoded: Vec<(f64, bool)> = frames
            .map(|frame| (frame.time_s, frame.picture.is_ok()))
            .collect();
        assert_eq!(decoded, [(0.0, true), (last as f64, false)]);
    }

    /// Of an open group of pictures: the frame that decoding can start at, and one that comes after it and is shown before it.
    #[test]
    fn a_frame_that_is_predicted_from_the_group_before_is_not_lost() {
        let path = golden("h265_open_groups.mp4");
        let limits = PhotoLimits::DEFAULT;
        let frames_of = |taken: &dyn Fn(&Movie) -> Vec<usize>| {
            let mut file = File::open(&path).unwrap();
            let movie = Movie::read(&path, &mut file, &limits).unwrap();
            let source = SampleSource::new(path.clone(), file, limits.max_memory_bytes);
            let taken = taken(&movie);
            VideoFrames::new(source, movie, taken).unwrap()
        };
        let all = frames_of(&|movie: &Movie| {
            let mut all: Vec<usize> = (0..movie.samples.len()).collect();
            all.sort_by_key(|&sample| movie.samples[sample].composition);
            all
        });
        let all: Vec<VideoFrame> = all.collect();
        let some = frames_of(&|movie: &Movie| {
            let samples = &movie.samples;
            let start = (1..samples.len()).find(|&sample| samples[sample].is_sync);
            let start = start.unwrap();
            assert!(samples[start + 1].composition < samples[start].composition);
            vec![0, start + 1, start]
        });
        let some: Vec<VideoFrame> = some.collect();
        assert_eq!(some.len(), 3);
        for frame in some {
            let whole = all.iter().find(|one| one.time_s == frame.time_s).unwrap();
            let picture = frame.picture.unwrap();
            assert!(picture == *whole.picture.as_ref().unwrap());
        }
    }
}
