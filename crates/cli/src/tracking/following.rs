//! A folder into which a camera or another program writes photos during the flight.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use anyhow::{Result, bail};
use grimnet_output::OutputPolicy;
use grimnet_photo::pictures::is_picture;

use super::frame_time::Epoch;
use super::frames::{EQUAL_TIMES, Frame, FrameOptions, Frames, frame_from_file};
use grimnet_answer::printable;

/// How often the folder is looked at.
const POLL: Duration = Duration::from_millis(50);
/// A file whose size and time of change stayed the same for this long is complete.
const COMPLETE_AFTER: Duration = Duration::from_millis(150);
/// One that cannot be used then may still be written, such as over a radio link that stalls: it is taken as it is after this long.
const BROKEN_AFTER: Duration = Duration::from_secs(3);

/// See the module.
pub struct Following {
    folder: PathBuf,
    options: FrameOptions,
    /// Ends after so long without a new file.
    idle: Option<Duration>,
    /// A frame that waited for this long is left out if there is a newer one.
    most_wait: Duration,
    /// Gets every photo that is found as an input.
    policy: OutputPolicy,
    /// Files that may still be written.
    growing: HashMap<PathBuf, Growing>,
    seen: HashSet<PathBuf>,
    ready: Vec<Ready>,
    /// The times of the photos that were ready, as bits.
    times: HashSet<u64>,
    warned_of_equal_times: bool,
    epoch: Option<Epoch>,
    is_coarse: bool,
    last_new: Instant,
    taken: usize,
    dropped: usize,
    without_time: usize,
}

/// What a file looks like from outside.
type Look = (u64, Option<SystemTime>);

/// A file that may still be written.
#[derive(Debug, Clone, Copy)]
struct Growing {
    look: Look,
    /// Since when it looks like that.
    since: Instant,
    /// It is complete if it looks like that for so long.
    complete_after: Duration,
    /// Its number among the frames, once it was taken for complete.
    number: Option<usize>,
}

struct Ready {
    path: PathBuf,
    file: Growing,
    time_s: f64,
    since: Instant,
}

impl Following {
    /// Follows the folder from now on; photos that are there already are the first frames.
    ///
    /// # Errors
    /// It is no folder.
    pub fn new(
        folder: &Path,
        options: FrameOptions,
        idle: Option<Duration>,
        most_wait: Duration,
        policy: OutputPolicy,
    ) -> Result<Self> {
        if !folder.is_dir() {
            bail!(
                "{}: expected a folder into which photos are being written",
                folder.display()
            );
        }
        Ok(Self {
            folder: folder.to_owned(),
            options,
            idle,
            most_wait,
            policy,
            growing: HashMap::new(),
            seen: HashSet::new(),
            ready: Vec::new(),
            times: HashSet::new(),
            warned_of_equal_times: false,
            epoch: None,
            is_coarse: false,
            last_new: Instant::now(),
            taken: 0,
            dropped: 0,
            without_time: 0,
        })
    }

    /// Looks for new complete files.
    fn look(&mut self, now: Instant) -> Result<()> {
        let mut complete = Vec::new();
        let mut listed = HashSet::new();
        for entry in fs_err::read_dir(&self.folder)? {
            let path = entry?.path();
            if self.seen.contains(&path) || !is_picture(&path) {
                continue;
            }
            // A file may be renamed between listing and looking.
            let Ok(metadata) = path.metadata() else {
                continue;
            };
            if !metadata.is_file() {
                continue;
            }
            listed.insert(path.clone());
            let look = (metadata.len(), metadata.modified().ok());
            let before = self.growing.get(&path);
            match before.filter(|before| before.look == look) {
                Some(same) => {
                    if now.duration_since(same.since) >= same.complete_after && look.0 > 0 {
                        complete.push(path);
                    }
                }
                None => {
                    let file = Growing {
                        look,
                        since: now,
                        complete_after: COMPLETE_AFTER,
                        number: before.and_then(|before| before.number),
                    };
                    self.last_new = now;
                    self.policy.add_inputs([&path]);
                    self.growing.insert(path, file);
                }
            }
        }
        // A program that writes aside and renames leaves names behind.
        self.growing.retain(|path, _| listed.contains(path));
        // Names are in order of time more often than the order of a folder is.
        complete.sort();
        for path in complete {
            if let Some(file) = self.growing.remove(&path) {
                self.seen.insert(path.clone());
                self.take(path, file, now);
            }
        }
        Ok(())
    }

    /// Puts a complete file among those that are ready, if it has a time.
    fn take(&mut self, path: PathBuf, mut file: Growing, now: Instant) {
        let number = file.number.unwrap_or(self.taken);
        let time = match self.options.time_of_file(number, &path) {
            Ok(time) => time,
            Err(reason) => {
                if !self.wait_longer(&path, file) {
                    self.without_time += 1;
                    tracing::warn!("{reason}");
                }
                return;
            }
        };
        if *self.epoch.get_or_insert(time.epoch) != time.epoch {
            self.without_time += 1;
            let name = path.display().to_string();
            tracing::warn!(
                "{}: left out: its time is not on the clock of the photos before it",
                printable(&name)
            );
            return;
        }
        let is_first = file.number.replace(number).is_none();
        self.taken += usize::from(is_first);
        self.is_coarse |= !time.has_fraction;
        let is_equal = is_first && !self.times.insert(time.time_s.to_bits());
        if is_equal && !std::mem::replace(&mut self.warned_of_equal_times, true) {
            let name = path.display().to_string();
            tracing::warn!(
                "{}: has the time of a photo before it, as others may have: {EQUAL_TIMES}",
                printable(&name)
            );
        }
        self.ready.push(Ready {
            path,
            file,
            time_s: time.time_s,
            since: now,
        });
    }

    /// Waits once more for a file that cannot be used, which may not be whole yet. Gives whether it does.
    fn wait_longer(&mut self, path: &Path, file: Growing) -> bool {
        let waits = file.complete_after < BROKEN_AFTER && path.is_file();
        if waits {
            let file = Growing {
                complete_after: BROKEN_AFTER,
                ..file
            };
            self.seen.remove(path);
            self.growing.insert(path.to_owned(), file);
        }
        waits
    }

    /// The next frame, if one is there.
    fn next_frame(&mut self, now: Instant) -> Result<Option<Frame>> {
        self.look(now)?;
        while let Some(ready) = self.next_ready(now) {
            let frame = frame_from_file(&ready.path, ready.time_s, &self.options);
            if frame.photo.is_ok() || !self.wait_longer(&ready.path, ready.file) {
                return Ok(Some(frame));
            }
        }
        Ok(None)
    }

    /// The next frame by time; those that waited for too long are dropped for newer ones.
    fn next_ready(&mut self, now: Instant) -> Option<Ready> {
        self.ready.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        while self.ready.len() > 1 && now.duration_since(self.ready[0].since) >= self.most_wait {
            let late = self.ready.remove(0);
            self.dropped += 1;
            tracing::info!("{}: dropped for a newer one", late.path.display());
        }
        (!self.ready.is_empty()).then(|| self.ready.remove(0))
    }
}

impl Frames for Following {
    fn next(&mut self, stop: &AtomicBool) -> Result<Option<Frame>> {
        loop {
            if stop.load(Ordering::Relaxed) {
                return Ok(None);
            }
            let now = Instant::now();
            if let Some(frame) = self.next_frame(now)? {
                // What is being processed is no idleness.
                self.last_new = self.last_new.max(now);
                return Ok(Some(frame));
            }
            // An empty file may stay so: a full disk, a camera without power.
            let waits = self.growing.values().any(|file| file.look.0 > 0);
            if !waits && self.idle.is_some_and(|idle| now - self.last_new >= idle) {
                return Ok(None);
            }
            std::thread::sleep(POLL);
        }
    }

    fn epoch(&self) -> Epoch {
        self.epoch.unwrap_or(Epoch::Unix)
    }

    fn newest_s(&self) -> Option<f64> {
        let times = self.ready.iter().map(|ready| ready.time_s);
        times.max_by(f64::total_cmp)
    }

    fn is_coarse(&self) -> bool {
        self.is_coarse
    }

    fn dropped(&self) -> usize {
        self.dropped
    }

    fn without_time(&self) -> usize {
        self.without_time
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn following(folder: &Path, most_wait: Duration) -> Following {
        let options = FrameOptions::default();
        let (idle, policy) = (Some(Duration::from_millis(1)), OutputPolicy::new());
        Following::new(folder, options, idle, most_wait, policy).unwrap()
    }

    /// A file that was the same for long, whatever is in it.
    fn whole() -> Growing {
        Growing {
            look: (1, None),
            since: Instant::now(),
            complete_after: BROKEN_AFTER,
            number: None,
        }
    }

    #[test]
    fn a_picture_that_is_written_with_pauses_is_taken_once_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let [slow, broken] = ["slow.jpg", "broken.jpg"].map(|name| folder.path().join(name));
        let mut following = following(folder.path(), Duration::from_secs(9));
        following.options.frames_per_s = Some(2.0);
        image::RgbImage::new(64, 48).save(&slow).unwrap();
        let bytes = fs_err::read(&slow).unwrap();
        let half = &bytes[..bytes.len() / 2];
        fs_err::write(&slow, half).unwrap();
        let begin = Instant::now();
        let mut next = |ms: u64| {
            let frame = following.next_frame(begin + Duration::from_millis(ms));
            let frame = frame.unwrap()?;
            let is_whole = frame.photo.is_ok();
            Some((Path::new(&frame.name).to_owned(), frame.time_s, is_whole))
        };
        assert_eq!([0, 200].map(&mut next), [None, None]);
        fs_err::write(&broken, half).unwrap();
        assert_eq!([1000, 1200].map(&mut next), [None, None]);
        fs_err::write(&slow, &bytes).unwrap();
        assert_eq!([1400, 1600].map(&mut next), [None, Some((slow, 0.0, true))]);
        assert_eq!(next(3900), None);
        assert_eq!(next(4100), Some((broken, 0.5, false)));
        assert_eq!(next(9000), None);
        assert!(!following.warned_of_equal_times);
    }

    #[test]
    fn only_complete_files_are_taken_and_each_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::from_secs(9));
        let begin = Instant::now();
        let at = |ms: u64| begin + Duration::from_millis(ms);
        let path = folder.path().join("frame_1.5.jpg");
        fs_err::write(&path, "a").unwrap();
        fs_err::write(folder.path().join("notes.txt"), "a").unwrap();
        following.look(at(0)).unwrap();
        fs_err::write(&path, "ab").unwrap();
        following.look(at(200)).unwrap();
        assert!(following.next_ready(at(200)).is_none(), "it grew");
        following.look(at(400)).unwrap();
        assert_eq!(following.next_ready(at(400)).unwrap().time_s, 1.5);
        following.look(at(800)).unwrap();
        assert!(following.next_ready(at(800)).is_none());
    }

    #[test]
    fn names_that_are_gone_and_empty_files_are_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::from_secs(9));
        fs_err::write(folder.path().join("empty.jpg"), "").unwrap();
        let aside = folder.path().join("part.jpg");
        fs_err::write(&aside, "a").unwrap();
        following.look(Instant::now()).unwrap();
        fs_err::rename(&aside, folder.path().join("frame_1.5.jpg")).unwrap();
        let stop = AtomicBool::new(false);
        assert_eq!(following.next(&stop).unwrap().unwrap().time_s, 1.5);
        assert!(following.next(&stop).unwrap().is_none());
    }

    #[test]
    fn the_newest_wins_and_the_others_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::from_secs(1));
        let begin = Instant::now();
        for name in ["f_1.0.jpg", "f_2.0.jpg", "f_3.0.jpg"] {
            following.take(folder.path().join(name), whole(), begin);
        }
        let in_time = following.next_ready(begin).unwrap();
        assert_eq!(in_time.time_s, 1.0);
        assert_eq!(following.newest_s(), Some(3.0));
        let later = begin + Duration::from_secs(2);
        assert_eq!(following.next_ready(later).unwrap().time_s, 3.0);
        assert_eq!(following.dropped, 1);
        following.take(folder.path().join("no time.jpg"), whole(), later);
        assert_eq!(following.without_time, 1);
    }

    #[test]
    fn without_a_wait_the_newest_is_taken_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::ZERO);
        let begin = Instant::now();
        for name in ["f_1.0.jpg", "f_2.0.jpg", "f_3.0.jpg"] {
            following.take(folder.path().join(name), whole(), begin);
        }
        assert_eq!(following.next_ready(begin).unwrap().time_s, 3.0);
        assert_eq!(following.dropped, 2);
        following.take(folder.path().join("f_4.0.jpg"), whole(), begin);
        assert_eq!(following.next_ready(begin).unwrap().time_s, 4.0);
    }

    #[test]
    fn equal_times_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::from_secs(1));
        for (name, expected) in [
            ("a_1.5.jpg", false),
            ("a_2.5.jpg", false),
            ("b_1.5.jpg", true),
        ] {
            following.take(folder.path().join(name), whole(), Instant::now());
            assert_eq!(following.warned_of_equal_times, expected, "{name}");
        }
    }

    #[test]
    fn times_to_the_second_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::from_secs(1));
        for (name, expected) in [
            ("20260621_100000_500.jpg", false),
            ("20260621_100001.jpg", true),
        ] {
            following.take(folder.path().join(name), whole(), Instant::now());
            assert_eq!(following.is_coarse(), expected, "{name}");
        }
    }

    #[test]
    fn it_ends_when_nothing_comes_and_when_it_is_told_to() {
        let folder = tempfile::tempdir().unwrap();
        let mut following = following(folder.path(), Duration::ZERO);
        assert!(following.next(&AtomicBool::new(false)).unwrap().is_none());
        following.idle = None;
        assert!(following.next(&AtomicBool::new(true)).unwrap().is_none());
        let (gone, policy) = (folder.path().join("no"), OutputPolicy::new());
        assert!(Following::new(&gone, following.options, None, POLL, policy).is_err());
    }
}
