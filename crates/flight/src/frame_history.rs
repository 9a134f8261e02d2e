//! Which frames came: the same exposure again, the same picture again, and times that go back because the camera's clock was set.

use std::collections::VecDeque;
use std::hash::{DefaultHasher, Hasher};

use grimnet_photo::Photo;

/// Frames are remembered for so long, seconds: a clock that is set by more is noticed by the filter.
const KEPT_S: f64 = 330.0;
/// A frame that is older than another one by more than this came late, or its clock was set back, seconds.
const LEAST_STEP_S: f64 = 2.0;
/// So many frames in a row must be older. Single ones come late.
const NEEDED: usize = 3;
/// Between their times there must be so many frames that came before: those that were held up on their way fill a gap.
const NEEDED_BETWEEN: usize = 2;
/// Every so many bytes of a picture are compared.
const BYTES_APART: usize = 61;

/// How a frame stands to those before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Arrival {
    /// Whether one of this time was remembered.
    pub is_repeated: bool,
    /// Whether its picture is another one than the last frame's: no two exposures have the same noise.
    pub is_new_picture: bool,
    /// By how much the camera's clock was set back, about, seconds (negative), if this frame confirms it.
    pub clock_step_s: Option<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Remembered {
    time_s: f64,
    picture: u64,
    /// How many frames came before it.
    number: u64,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(crate) struct FrameHistory {
    frames: VecDeque<Remembered>,
    /// Frames so far.
    count: u64,
    newest_s: Option<f64>,
    last_picture: Option<u64>,
    /// Times of the latest frames in a row that are older than others, seconds, and how many came before them.
    older_s: Vec<f64>,
    older_since: u64,
}

impl FrameHistory {
    /// Takes in a frame.
    pub fn arrive(&mut self, photo: &Photo, time_s: f64) -> Arrival {
        self.arrive_with(picture_of(photo), time_s)
    }

    fn arrive_with(&mut self, picture: u64, time_s: f64) -> Arrival {
        let is_resent = self
            .frames
            .iter()
            .any(|frame| frame.time_s == time_s && frame.picture == picture);
        let is_new_picture = self.last_picture.replace(picture) != Some(picture);
        let clock_step_s = (!is_resent && time_s.is_finite())
            .then(|| self.step_back_s(time_s))
            .flatten();
        if clock_step_s.is_some() {
            self.restart();
        }
        Arrival {
            is_repeated: self.frames.iter().any(|frame| frame.time_s == time_s),
            is_new_picture,
            clock_step_s,
        }
    }

    /// By how much the clock was set back, if the latest frames say so together.
    fn step_back_s(&mut self, time_s: f64) -> Option<f64> {
        let newest_s = self.newest_s?;
        if time_s >= newest_s - LEAST_STEP_S {
            self.older_s.clear();
            return None;
        }
        if self.older_s.last().is_none_or(|last_s| time_s <= *last_s) {
            self.older_s.clear();
            self.older_since = self.count;
        }
        self.older_s.push(time_s);
        let first_s = *self.older_s.first()?;
        let between = self.frames.iter().filter(|frame| {
            frame.number < self.older_since && (first_s..=time_s).contains(&frame.time_s)
        });
        (self.older_s.len() >= NEEDED && between.count() >= NEEDED_BETWEEN)
            .then_some(first_s - newest_s)
    }

    /// Remembers the frame that arrived last, which could be used.
    pub fn remember(&mut self, time_s: f64) {
        let Some(picture) = self.last_picture.filter(|_| time_s.is_finite()) else {
            return;
        };
        let newest_s = self
            .newest_s
            .map_or(time_s, |newest_s| newest_s.max(time_s));
        self.newest_s = Some(newest_s);
        self.frames
            .retain(|other| (other.time_s - time_s).abs() <= KEPT_S);
        self.frames.push_back(Remembered {
            time_s,
            picture,
            number: self.count,
        });
        self.count += 1;
    }

    /// Forgets the times of all frames: they are of another clock.
    pub fn restart(&mut self) {
        *self = Self {
            last_picture: self.last_picture,
            ..Self::default()
        };
    }
}

/// A number that differs between pictures.
fn picture_of(photo: &Photo) -> u64 {
    let mut hasher = DefaultHasher::new();
    let sample = photo.image.as_raw().iter().step_by(BYTES_APART).copied();
    hasher.write(&sample.collect::<Vec<u8>>());
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames with a picture each, one after the other at these times. Gives the number of the frame that confirms a step, and the
    /// step in seconds.
    fn step(times_s: impl IntoIterator<Item = f64>) -> Option<(usize, f64)> {
        let mut history = FrameHistory::default();
        times_s
            .into_iter()
            .enumerate()
            .find_map(|(number, time_s)| {
                let arrival = history.arrive_with(number as u64, time_s);
                history.remember(time_s);
                arrival.clock_step_s.map(|step_s| (number, step_s))
            })
    }

    fn seconds(range: std::ops::Range<u32>) -> impl Iterator<Item = f64> {
        range.map(f64::from)
    }

    #[test]
    fn the_third_frame_of_a_clock_that_was_set_back_confirms_it() {
        for by_s in [-8.0, -20.0, -20.4, -100.0, -300.0] {
            let after = seconds(400..410).map(|time_s| time_s + by_s);
            let (number, step_s) = step(seconds(0..400).chain(after)).unwrap();
            assert_eq!(number, 402, "{by_s}");
            assert!((step_s - by_s).abs() <= 1.01, "{by_s}: {step_s}");
        }
    }

    #[test]
    fn frames_that_come_late_set_no_clock() {
        // Single ones; frames that fill a gap; a pause.
        let late = seconds(0..100).flat_map(|time_s| [time_s, time_s - 20.5]);
        assert_eq!(step(late), None);
        let gap = seconds(0..50).chain(seconds(70..80));
        assert_eq!(step(gap.chain(seconds(50..70))), None);
        assert_eq!(step(seconds(0..50).chain(seconds(170..180))), None);
    }

    #[test]
    fn what_is_sent_again_sets_no_clock_and_is_repeated() {
        let mut history = FrameHistory::default();
        for number in 0..20 {
            history.arrive_with(number, number as f64);
            history.remember(number as f64);
        }
        for number in 5..15 {
            let arrival = history.arrive_with(number, number as f64);
            assert!(arrival.is_repeated && arrival.clock_step_s.is_none());
        }
        assert!(history.arrive_with(3, 20.0).is_new_picture);
        assert!(!history.arrive_with(3, 21.0).is_new_picture);
    }

    #[test]
    fn a_step_is_noticed_where_every_time_comes_again() {
        // Frames of times that are there already are not remembered.
        let mut history = FrameHistory::default();
        for number in 0..30 {
            history.arrive_with(number, number as f64);
            history.remember(number as f64);
        }
        let steps: Vec<bool> = (30..33)
            .map(|number| {
                let arrival = history.arrive_with(number, number as f64 - 10.0);
                assert_eq!(arrival.is_repeated, number < 32);
                arrival.clock_step_s.is_some()
            })
            .collect();
        assert_eq!(steps, [false, false, true]);
    }
}
