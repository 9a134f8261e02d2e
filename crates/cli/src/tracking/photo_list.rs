//! Photos of a flight that is over, in order of time.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, bail};

use super::frame_time::{Epoch, FrameTime};
use super::frames::{EQUAL_TIMES, Frame, FrameOptions, Frames, frame_from_file};
use grimnet_answer::printable;

/// A step of time above this gets a warning, seconds: a clock may have been set, or the aircraft landed.
const LARGE_STEP_S: f64 = 300.0;

/// See the module.
pub struct PhotoList {
    /// In order of time.
    photos: Vec<(PathBuf, f64)>,
    next: usize,
    epoch: Epoch,
    without_time: usize,
    options: FrameOptions,
}

impl PhotoList {
    /// Reads the times of the photos and brings them into order.
    ///
    /// # Errors
    /// No photo has a time.
    pub fn new(paths: Vec<PathBuf>, options: &FrameOptions) -> Result<Self> {
        let count = paths.len();
        let mut timed: Vec<(PathBuf, FrameTime)> = Vec::with_capacity(count);
        let (mut without_time, mut first_reason) = (0, None);
        for (number, path) in paths.into_iter().enumerate() {
            match options.time_of_file(number, &path) {
                Ok(time) => timed.push((path, time)),
                Err(reason) => {
                    without_time += 1;
                    tracing::warn!("{reason}");
                    first_reason.get_or_insert(reason);
                }
            }
        }
        let Some(epoch) = common_epoch(&timed) else {
            bail!(
                "none of the {count} photos has a time; the first, {}",
                first_reason.unwrap_or_default()
            );
        };
        let other = |(_, time): &(PathBuf, FrameTime)| time.epoch != epoch;
        for (path, _) in timed.iter().filter(|photo| other(photo)) {
            without_time += 1;
            let name = path.display().to_string();
            tracing::warn!(
                "{}: left out: its time is not on the clock of the others",
                printable(&name)
            );
        }
        timed.retain(|photo| !other(photo));
        timed.sort_by(|a, b| a.1.time_s.total_cmp(&b.1.time_s).then(a.0.cmp(&b.0)));
        warn_of_odd_times(&timed);
        Ok(Self {
            photos: timed
                .into_iter()
                .map(|(path, time)| (path, time.time_s))
                .collect(),
            next: 0,
            epoch,
            without_time,
            options: *options,
        })
    }
}

/// What most times count from.
fn common_epoch(timed: &[(PathBuf, FrameTime)]) -> Option<Epoch> {
    let unix = timed
        .iter()
        .filter(|(_, time)| time.epoch == Epoch::Unix)
        .count();
    match timed.len() {
        0 => None,
        all if 2 * unix >= all => Some(Epoch::Unix),
        _ => Some(Epoch::Start),
    }
}

fn warn_of_odd_times(timed: &[(PathBuf, FrameTime)]) {
    let mut equal = 0;
    for pair in timed.windows(2) {
        let step_s = pair[1].1.time_s - pair[0].1.time_s;
        equal += usize::from(step_s == 0.0);
        if step_s > LARGE_STEP_S {
            let name = pair[1].0.display().to_string();
            tracing::warn!(
                "{}: taken {step_s:.0} s after the photo before it; was the clock set?",
                printable(&name)
            );
        }
    }
    if equal > 0 {
        tracing::warn!(
            "{equal} of {} photos have the time of the one before them: {EQUAL_TIMES}",
            timed.len()
        );
    }
}

impl Frames for PhotoList {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        if stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let Some((path, time_s)) = self.photos.get(self.next) else {
            return Ok(None);
        };
        self.next += 1;
        Ok(Some(frame_from_file(path, *time_s, &self.options)))
    }

    fn epoch(&self) -> Epoch {
        self.epoch
    }

    fn count(&self) -> Option<usize> {
        Some(self.photos.len())
    }

    fn without_time(&self) -> usize {
        self.without_time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &PhotoList) -> Vec<String> {
        let name = |(path, _): &(PathBuf, f64)| path.display().to_string();
        list.photos.iter().map(name).collect()
    }

    fn options(frames_per_s: Option<f64>) -> FrameOptions {
        FrameOptions {
            frames_per_s,
            ..FrameOptions::default()
        }
    }

    #[test]
    fn photos_come_in_order_of_time_and_those_without_are_counted() {
        let paths = [
            "b_10.5.jpg",
            "a_11.0.jpg",
            "c.jpg",
            "d_9.0.jpg",
            "20260621_100000.jpg",
        ];
        let list = PhotoList::new(paths.map(PathBuf::from).to_vec(), &options(None)).unwrap();
        assert_eq!(names(&list), ["d_9.0.jpg", "b_10.5.jpg", "a_11.0.jpg"]);
        assert_eq!((list.without_time, list.epoch), (2, Epoch::Start));
        let numbered = ["c.jpg", "a.jpg"].map(PathBuf::from).to_vec();
        let list = PhotoList::new(numbered, &options(Some(2.0))).unwrap();
        assert_eq!(names(&list), ["c.jpg", "a.jpg"]);
        assert_eq!(list.photos[1].1, 0.5);
        assert!(PhotoList::new(vec!["c.jpg".into()], &options(None)).is_err());
    }
}
