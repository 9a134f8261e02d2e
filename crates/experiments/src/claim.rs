//! What is kept beside a stored `summary.json`: what was measured, by which command, and other systems' figures.

use serde::{Deserialize, Serialize};

/// The description of a stored `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Heading of its section.
    pub title: String,
    /// Photos, map and truth.
    pub data: String,
    /// The command that measured it.
    pub command: String,
    /// Figures of other systems on the same photos.
    #[serde(default)]
    pub peers: Vec<Peer>,
    /// Remarks on the figures.
    #[serde(default)]
    pub remarks: Vec<String>,
}

/// Another system's figures on the same frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Peer {
    /// Its name.
    pub name: String,
    /// The run that it is compared with, such as `heading_known`.
    pub run: String,
    /// Share of all frames within 5 m.
    pub within_5m: f64,
    /// Share of all frames within 10 m.
    pub within_10m: f64,
    /// Share of all frames within 20 m.
    pub within_20m: f64,
    /// Median error, metres.
    pub median_m: f64,
    /// Who measured it, and how.
    pub source: String,
}
