//! What the localiser answers.

use std::time::Instant;

use grimnet_pack::Level;
use grimnet_photo::{Evidence, View};
use serde::Serialize;

use crate::{candidates::Candidate, confidence::Support, gates::Rejection};

/// The answer for one photo.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state")]
pub enum Outcome {
    /// Its place was found.
    Fix(Box<Fix>),
    /// It was not, with the reason.
    NoFix(Box<NoFix>),
}

impl Outcome {
    /// The fix, if there is one.
    pub fn fix(&self) -> Option<&Fix> {
        match self {
            Self::Fix(fix) => Some(fix),
            Self::NoFix(_) => None,
        }
    }

    /// Time by stage.
    pub fn time_ms(&self) -> &TimeMs {
        match self {
            Self::Fix(fix) => &fix.time_ms,
            Self::NoFix(no_fix) => &no_fix.time_ms,
        }
    }
}

/// Where the photo was taken. Positions are of the ground at the photo's centre, not of the aircraft.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fix {
    /// Latitude of the photo's centre, degrees north.
    pub lat_deg: f64,
    /// Longitude of the photo's centre, degrees east.
    pub lon_deg: f64,
    /// Bearing of the photo's top, degrees clockwise from true north.
    pub heading_deg: f64,
    /// Ground metres per pixel of the photo at full size, at its centre.
    pub gsd_m: f64,
    /// 1-sigma covariance of the position, square metres: east-east, east-north, north-north. It includes the map's own error
    /// ([`crate::Options::map_error_m`]).
    pub covariance_en_m2: [f64; 3],
    /// The true position lies within this distance with 95 % probability, metres.
    pub radius95_m: f64,
    /// Probability that it is right and not another place; none where the model's calibration has no such figure.
    pub confidence: Option<f64>,
    /// What that and the covariance are made from.
    pub support: Support,
    /// Matches that agree with the transform.
    pub inliers: usize,
    /// Matches.
    pub matches: usize,
    /// The tile that was matched.
    pub tile: TileRef,
    /// The best candidate at another place.
    pub runner_up: Option<RunnerUp>,
    /// Corners of the photo (top left, top right, bottom right, bottom left): longitude, latitude in degrees. Fewer where one
    /// lies beyond the horizon.
    pub outline_lonlat_deg: Vec<[f64; 2]>,
    /// What the answer rests on.
    pub evidence: EvidenceUsed,
    /// Time by stage.
    pub time_ms: TimeMs,
    /// Matched points, where [`crate::Options::keep_matches`] asked for them.
    #[serde(skip)]
    pub drawn: Option<Box<MatchedPoints>>,
}

/// A tile of the pack.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TileRef {
    /// Level of the pack, 0 the finest.
    pub level: usize,
    /// Ground resolution of the level, metres a pixel.
    pub gsd_m: f64,
    /// Index in the level.
    pub index: usize,
    /// Similarity of the global descriptors.
    pub similarity: f32,
    /// Votes for one translation; 0 where none were held.
    pub votes: u32,
}

impl TileRef {
    pub(crate) fn of(level_index: usize, level: &Level, candidate: &Candidate) -> Self {
        Self {
            level: level_index,
            gsd_m: level.gsd_m(),
            index: candidate.tile,
            similarity: candidate.similarity,
            votes: candidate.peak.votes,
        }
    }
}

/// The best candidate at another place than the answer's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RunnerUp {
    /// Latitude, degrees north.
    pub lat_deg: f64,
    /// Longitude, degrees east.
    pub lon_deg: f64,
    /// Matches that agree there.
    pub inliers: usize,
}

/// Points matched between the photo and the map.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchedPoints {
    /// Continuous pixels of `Photo::image`, continuous pixels of the map, and whether the pair agrees with the transform.
    pub pairs: Vec<([f64; 2], [f64; 2], bool)>,
    /// The tile on the map: left, top, width, height in map pixels.
    pub tile_map_px: [f64; 4],
    /// The photo's corners (top left, top right, bottom right, bottom left) in map pixels; none without a transform.
    pub outline_map_px: Vec<[f64; 2]>,
}

/// What was believed of the photo's metadata and the caller's word, and what was not.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct EvidenceUsed {
    /// What was used.
    pub used: Vec<Evidence>,
    /// What was set aside, and why.
    pub set_aside: Vec<Evidence>,
    /// What was assumed where nothing was known, in words: the round of hypotheses that gave the answer.
    pub assumed: Option<String>,
}

impl EvidenceUsed {
    pub(crate) fn of(view: &View) -> Self {
        Self {
            used: view.used.clone(),
            set_aside: view.set_aside.clone(),
            assumed: None,
        }
    }
}

/// Why there is no fix, with what was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoFix {
    /// Why.
    pub reason: Reason,
    /// Matches of the best candidate that agree.
    pub inliers: usize,
    /// Matches of the best candidate.
    pub matches: usize,
    /// What was believed and what was not.
    pub evidence: EvidenceUsed,
    /// Time by stage.
    pub time_ms: TimeMs,
    /// Matched points of the best candidate, where asked for.
    #[serde(skip)]
    pub drawn: Option<Box<MatchedPoints>>,
}

impl std::fmt::Display for NoFix {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.reason.fmt(f)
    }
}

/// Why there is no fix.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, thiserror::Error)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Reason {
    /// The photo has no texture: water, snow, cloud, night, blur.
    #[error(
        "the photo shows too little to recognise ({found} keypoints): water, snow, cloud, night or blur?"
    )]
    TooFewKeypoints {
        /// Keypoints found.
        found: usize,
    },
    /// No tile of the pack may show the photo.
    #[error("the pack has no tile in the given area")]
    NoTiles,
    /// The best candidate did not pass a gate.
    #[error("no place on the map fits well enough: {0}")]
    Rejected(Rejection),
}

/// Wall time by stage, milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TimeMs {
    /// Resampling the photo.
    pub query: f64,
    /// The network.
    pub features: f64,
    /// Search by descriptor.
    pub search: f64,
    /// The translation vote.
    pub vote: f64,
    /// Full matching, transform, gates and refinement.
    pub matching: f64,
    /// Everything, decoding apart.
    pub total: f64,
}

/// Milliseconds since then.
pub(crate) fn elapsed_ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
