//! The clock of a link.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Seconds that never go back and do not jump when the system's clock is set.
///
/// All that a link says of time is on this clock: the times of telemetry and the times for which it asks the track. The
/// exposure times of frames must be on it too.
#[derive(Debug, Clone, Copy)]
pub struct LinkClock {
    start: Instant,
    start_s: f64,
}

impl LinkClock {
    /// Seconds since 1970-01-01 UTC, as the system's clock has it now.
    #[must_use]
    pub fn unix() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH);
        Self::from_time_s(since.unwrap_or(Duration::ZERO).as_secs_f64())
    }

    /// A clock that shows `time_s` now. For flights that are played again.
    #[must_use]
    pub fn from_time_s(time_s: f64) -> Self {
        Self {
            start: Instant::now(),
            start_s: time_s,
        }
    }

    /// What the clock shows.
    #[must_use]
    pub fn now_s(&self) -> f64 {
        self.start_s + self.start.elapsed().as_secs_f64()
    }
}
