//! Figures of rendered frames.

use serde::Serialize;

use super::figures::Consistency;
use super::frame_record::{FrameRecord, MeasuredMotion};
use crate::metrics::statistics::percentile;

/// Figures of rendered frames.
#[derive(Debug, Clone, Serialize)]
pub struct FrameFigures {
    /// Frames.
    pub frames: usize,
    /// Frames over water and snow.
    pub covered: usize,
    /// Fixes on frames over water and snow.
    pub covered_fixes: usize,
    /// Share of fixes that a window of the filter gave.
    pub tracked_share: f64,
    /// Median time of a tracked frame: search and motion, without rendering and decoding, milliseconds.
    pub tracked_time_p50_ms: Option<f64>,
    /// 95th percentile of it.
    pub tracked_time_p95_ms: Option<f64>,
    /// Frames, without covered ones, with a motion from the frame before.
    pub motion_share: f64,
    /// Motions on covered frames.
    pub covered_motions: usize,
    /// Median error of a motion over its distance, of covered frames too.
    pub motion_error_share_p50: Option<f64>,
    /// 90th percentile of it.
    pub motion_error_share_p90: Option<f64>,
    /// Median absolute error of the turn, degrees.
    pub turn_error_p50_deg: Option<f64>,
    /// Squared errors of motions over the stated variance per axis, that of 7 % of the distance added.
    pub motion_nees: Option<Consistency>,
}

/// Error of motion between frames relative to the distance, as the filter's options have it.
const MOTION_SIGMA: f64 = 0.07;

impl FrameFigures {
    /// Of all frames.
    #[must_use]
    pub fn of<'a>(frames: impl Iterator<Item = &'a FrameRecord> + Clone) -> Self {
        let open = frames.clone().filter(|frame| frame.cover.is_none());
        let covered = frames.clone().filter(|frame| frame.cover.is_some());
        let fixes = frames.clone().filter(|frame| frame.fix.is_some());
        let tracked = fixes.clone().filter(|frame| frame.tracked);
        let times: Vec<f64> = tracked.clone().map(|frame| frame.time_ms).collect();
        let motions: Vec<_> = frames.clone().filter_map(|frame| frame.motion).collect();
        let of =
            |value: fn(&MeasuredMotion) -> f64| -> Vec<f64> { motions.iter().map(value).collect() };
        let shares = of(|m| m.error_m / m.distance_m.max(1.0));
        let turns = of(|m| m.turn_error_deg.abs());
        let nees =
            of(|m| m.error_m.powi(2) / (m.sigma_m.powi(2) + (MOTION_SIGMA * m.distance_m).powi(2)));
        let share = |part: usize, all: usize| part as f64 / all.max(1) as f64;
        let is_joined = |frame: &&FrameRecord| frame.motion.is_some();
        Self {
            frames: frames.clone().count(),
            covered: covered.clone().count(),
            covered_fixes: covered.clone().filter(|frame| frame.fix.is_some()).count(),
            tracked_share: share(times.len(), fixes.count()),
            tracked_time_p50_ms: percentile(&times, 0.5),
            tracked_time_p95_ms: percentile(&times, 0.95),
            motion_share: share(open.clone().filter(is_joined).count(), open.count()),
            covered_motions: covered.filter(is_joined).count(),
            motion_error_share_p50: percentile(&shares, 0.5),
            motion_error_share_p90: percentile(&shares, 0.9),
            turn_error_p50_deg: percentile(&turns, 0.5),
            motion_nees: Consistency::of(&nees),
        }
    }
}
