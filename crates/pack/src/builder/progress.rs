//! Progress and result of a build.

use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The phase of a build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Computing normalisation statistics on the map.
    Adapting,
    /// Computing features of tiles.
    Tiles,
    /// Assembling the file and training indexes.
    Writing,
}

/// Progress of a build.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Current phase.
    pub phase: Phase,
    /// Index of the current level.
    pub level: usize,
    /// Ground resolution of that level, metres per pixel.
    pub gsd_m: f64,
    /// Finished tiles of all levels, skipped ones and those of an earlier run included.
    pub tiles_done: u64,
    /// Tiles of all levels.
    pub tiles_total: u64,
    /// Tiles that were skipped so far.
    pub tiles_skipped: u64,
    /// Tiles that an earlier, interrupted run finished.
    pub tiles_resumed: u64,
    /// Tiles per second in this run, skipped ones left out.
    pub tiles_per_s: f64,
    /// Estimated time to the end of [`Phase::Tiles`].
    pub time_left: Option<Duration>,
}

/// Result of a build.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildReport {
    /// Path of the pack.
    pub path: PathBuf,
    /// Its size, bytes.
    pub len_bytes: u64,
    /// Tiles with a descriptor, of all levels.
    pub tiles: u64,
    /// Tiles that were skipped.
    pub tiles_skipped: u64,
    /// Tiles that an earlier, interrupted run finished.
    pub tiles_resumed: u64,
    /// Whether a complete pack of the same map, model and options existed already, so that nothing was done.
    pub was_complete: bool,
    /// Duration of this run.
    pub duration: Duration,
}

/// Counts tiles and time.
#[derive(Debug)]
pub struct Meter {
    started: Instant,
    pub progress: Progress,
    computed: u64,
    pending: u64,
}

impl Meter {
    /// Starts the clock.
    pub fn new(tiles_total: u64) -> Self {
        let progress = Progress {
            phase: Phase::Tiles,
            level: 0,
            gsd_m: 0.0,
            tiles_done: 0,
            tiles_total,
            tiles_skipped: 0,
            tiles_resumed: 0,
            tiles_per_s: 0.0,
            time_left: None,
        };
        Self {
            started: Instant::now(),
            progress,
            computed: 0,
            pending: 0,
        }
    }

    /// Counts tiles that an earlier run finished.
    pub fn resume(&mut self, places: u64, skipped: u64) {
        self.progress.tiles_done += places;
        self.progress.tiles_skipped += skipped;
        self.progress.tiles_resumed += places;
    }

    /// Counts tiles of this run.
    pub fn advance(&mut self, places: u64, skipped: u64) {
        self.progress.tiles_done += places;
        self.progress.tiles_skipped += skipped;
        self.computed += places - skipped;
        self.pending += places;
        let seconds = self.started.elapsed().as_secs_f64().max(1e-9);
        self.progress.tiles_per_s = self.computed as f64 / seconds;
        let left = self
            .progress
            .tiles_total
            .saturating_sub(self.progress.tiles_done);
        let places_per_s = self.pending as f64 / seconds;
        self.progress.time_left = (places_per_s > 0.0)
            .then(|| Duration::from_secs_f64((left as f64 / places_per_s).min(1e9)));
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }
}
