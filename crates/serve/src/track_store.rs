//! The tracks that clients have begun.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use grimnet_flight::Flight;
use serde::Serialize;
use tokio::sync::{Semaphore, watch};

use crate::problem::{Problem, ProblemKind};
use crate::track_frame::TrackFrame;

/// Tracks at the same time. A new one takes the place of the one that got no frame for longest.
const MAX_TRACKS: usize = 64;

/// A track without a frame for so long may be given up for a new one, seconds.
const IDLE_S: f64 = 600.0;

/// Frames that a track keeps; older ones are given up.
const MAX_FRAMES: usize = 20_000;

/// One track.
#[derive(Debug)]
pub(crate) struct Track {
    pub id: u64,
    pub map: String,
    /// Frames are taken in one after the other.
    pub turn: Arc<Semaphore>,
    flight: Mutex<Flight>,
    frames: Mutex<VecDeque<Arc<TrackFrame>>>,
    /// Number of the frame with which the flight last began again: the frames before may be of another clock.
    first_since_restart: AtomicU64,
    /// Number of the latest frame.
    latest: watch::Sender<u64>,
    /// Becomes true when the track ends.
    ended: watch::Sender<bool>,
    used: Mutex<Instant>,
}

/// A track, as clients see it.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Track)]
pub(crate) struct TrackSummary {
    /// Name of the track in addresses. No other track gets it, also after the service was started again.
    id: u64,
    /// The map that it is on.
    map: String,
    /// Frames that it got.
    frames: u64,
    /// State at the latest time of its frames, some of which may come late: `searching`, `tracking`, `coasting`, `ambiguous` or `lost`;
    /// `null` while nothing is known of the aircraft. Where a clock was set, of the frames since then.
    #[schema(value_type = Option<String>)]
    state: Option<grimnet_track::TrackState>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What is inside is whole after a panic: it is changed by single assignments, and a flight may be in any state.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Track {
    /// The flight, to give it a frame.
    pub(crate) fn flight(&self) -> MutexGuard<'_, Flight> {
        locked(&self.flight)
    }

    /// Adds a frame under the next number, and tells those who listen. `is_after_restart`: the flight began again with it.
    pub(crate) fn add(&self, mut frame: TrackFrame, is_after_restart: bool) -> Arc<TrackFrame> {
        let mut frames = locked(&self.frames);
        frame.number = *self.latest.borrow() + 1;
        if is_after_restart {
            self.first_since_restart
                .store(frame.number, Ordering::Relaxed);
        }
        if frames.len() >= MAX_FRAMES {
            frames.pop_front();
        }
        let frame = Arc::new(frame);
        frames.push_back(frame.clone());
        drop(frames);
        *locked(&self.used) = Instant::now();
        self.latest.send_replace(frame.number);
        frame
    }

    /// The first frame after number `after` that is kept.
    pub(crate) fn next_after(&self, after: u64) -> Option<Arc<TrackFrame>> {
        let frames = locked(&self.frames);
        let first = frames.front()?.number;
        let at = after.saturating_add(1).saturating_sub(first);
        frames.get(usize::try_from(at).ok()?).cloned()
    }

    /// The frame of a time, if it is kept.
    pub(crate) fn at(&self, time_s: f64) -> Option<Arc<TrackFrame>> {
        let frames = locked(&self.frames);
        // It is one of the latest.
        let mut latest_first = frames.iter().rev();
        latest_first.find(|frame| frame.time_s == time_s).cloned()
    }

    /// All frames that are kept, in order of time: some come late.
    pub(crate) fn frames(&self) -> Vec<Arc<TrackFrame>> {
        let mut frames: Vec<_> = locked(&self.frames).iter().cloned().collect();
        frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        frames
    }

    /// Changes when a frame is added.
    pub(crate) fn listen(&self) -> watch::Receiver<u64> {
        self.latest.subscribe()
    }

    /// Becomes true when the track ends.
    pub(crate) fn listen_for_end(&self) -> watch::Receiver<bool> {
        self.ended.subscribe()
    }

    pub(crate) fn summary(&self) -> TrackSummary {
        let first = self.first_since_restart.load(Ordering::Relaxed);
        let state = locked(&self.frames)
            .iter()
            .filter(|frame| frame.number >= first)
            .filter_map(|frame| frame.point)
            .max_by(|a, b| a.time_s.total_cmp(&b.time_s))
            .map(|point| point.state);
        TrackSummary {
            id: self.id,
            map: self.map.clone(),
            frames: *self.latest.borrow(),
            state,
        }
    }
}

/// All tracks, by number.
#[derive(Debug, Default)]
pub(crate) struct Tracks(Mutex<Held>);

#[derive(Debug, Default)]
struct Held {
    latest_id: u64,
    tracks: BTreeMap<u64, Arc<Track>>,
}

impl Held {
    fn end(&mut self, id: u64) {
        if let Some(track) = self.tracks.remove(&id) {
            track.ended.send_replace(true);
        }
    }
}

/// Milliseconds since 1970.
fn unix_ms() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| since.as_millis() as u64)
}

impl Tracks {
    /// Begins a track.
    ///
    /// # Errors
    /// Status 503 if there are too many, and none of them is idle.
    pub(crate) fn begin(&self, map: &str, flight: Flight) -> Result<Arc<Track>, Problem> {
        let mut held = locked(&self.0);
        if held.tracks.len() >= MAX_TRACKS {
            let idle = |track: &Track| locked(&track.used).elapsed().as_secs_f64();
            let tracks = held.tracks.values().map(|track| (idle(track), track.id));
            let oldest = tracks.max_by(|a, b| a.0.total_cmp(&b.0));
            let (idle_s, id) = oldest.unwrap_or_default();
            if idle_s <= IDLE_S {
                return Err(Problem::unavailable(
                    ProblemKind::Tracks,
                    format!("{MAX_TRACKS} tracks are in use; end one with DELETE"),
                    (IDLE_S - idle_s).ceil() as u64 + 1,
                ));
            }
            held.end(id);
        }
        // Greater than those of all earlier tracks, also of the service before it was started again: a client of an ended track is not
        // to be answered with another one's positions. Below 2^53, which JavaScript can hold.
        held.latest_id = (held.latest_id + 1).max(unix_ms());
        let track = Arc::new(Track {
            id: held.latest_id,
            map: map.to_owned(),
            turn: Arc::new(Semaphore::new(1)),
            flight: Mutex::new(flight),
            frames: Mutex::default(),
            first_since_restart: AtomicU64::new(0),
            latest: watch::Sender::new(0),
            ended: watch::Sender::new(false),
            used: Mutex::new(Instant::now()),
        });
        held.tracks.insert(track.id, track.clone());
        Ok(track)
    }

    /// The track with a number.
    ///
    /// # Errors
    /// Status 404 if there is none.
    pub(crate) fn get(&self, id: &str) -> Result<Arc<Track>, Problem> {
        let number: Option<u64> = id.parse().ok();
        let held = locked(&self.0);
        number
            .and_then(|number| held.tracks.get(&number).cloned())
            .ok_or_else(|| Problem::not_found(format!("there is no track {id:?}")))
    }

    /// Ends a track, also for those who follow it.
    pub(crate) fn end(&self, track: &Track) {
        locked(&self.0).end(track.id);
    }

    pub(crate) fn summaries(&self) -> Vec<TrackSummary> {
        let tracks: Vec<_> = locked(&self.0).tracks.values().cloned().collect();
        tracks.iter().map(|track| track.summary()).collect()
    }
}
