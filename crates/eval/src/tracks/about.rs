//! The conditions of an evaluation of tracks.

use serde::Serialize;

/// Conditions of the measurement.
#[derive(Debug, Clone, Serialize)]
pub struct TrackAbout {
    /// What was flown.
    pub data: String,
    /// Identity of the model.
    pub model_hash: String,
    /// Commit that the program was built from, if given.
    pub commit: Option<String>,
    /// Version of the program.
    pub version: &'static str,
    /// Threads that searched.
    pub threads: usize,
}
