//! The answer of the localiser.

use std::{ops::AddAssign, time::Instant};

use grimnet_geo::{MapPx, WindowPx};
use grimnet_photo::{Damage, Evidence, PhotoPx, View};
use serde::{Deserialize, Serialize};

use crate::confidence::Support;

/// The answer for one photo. It has these two states only, so a `match` needs no wildcard arm.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "state")]
pub enum Outcome {
    /// The position was found.
    Fix(Box<Fix>),
    /// The position was not found.
    NoFix(Box<NoFix>),
}

impl Outcome {
    /// The fix; `None` without one.
    pub fn fix(&self) -> Option<&Fix> {
        match self {
            Self::Fix(fix) => Some(fix),
            Self::NoFix(_) => None,
        }
    }

    /// Wall time by stage.
    pub fn time_ms(&self) -> &TimeMs {
        match self {
            Self::Fix(fix) => &fix.time_ms,
            Self::NoFix(no_fix) => &no_fix.time_ms,
        }
    }
}

/// The position of a photo: of the ground at the photo's centre, not of the aircraft.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fix {
    /// Latitude of the photo's centre, degrees north.
    pub lat_deg: f64,
    /// Longitude of the photo's centre, degrees east.
    pub lon_deg: f64,
    /// Bearing of the photo's top, degrees clockwise from true north. `None` in paper mode if the transform is unusable.
    pub heading_deg: Option<f64>,
    /// Ground metres per pixel of the photo at full size, at its centre.
    pub gsd_m: f64,
    /// 1-sigma covariance of the position, square metres: east-east, east-north, north-north. It includes the registration
    /// error of the map ([`crate::Options::map_error_m`]).
    pub covariance_en_m2: [f64; 3],
    /// Radius of the circle that contains the true position with 95 % probability, metres.
    pub radius95_m: f64,
    /// Probability that this is the right position and not another one; `None` in paper mode, or if the model is not calibrated.
    pub confidence: Option<f64>,
    /// The figures from which confidence and covariance are computed.
    pub support: Support,
    /// Number of matches that agree with the transform.
    pub inliers: usize,
    /// Number of matches.
    pub matches: usize,
    /// The tile that was matched.
    pub tile: TileRef,
    /// The best candidate at another position.
    pub runner_up: Option<RunnerUp>,
    /// Corners of the photo (top left, top right, bottom right, bottom left) as GeoJSON positions: longitude, latitude, degrees.
    /// Corners beyond the horizon are left out.
    pub outline_lon_lat_deg: Vec<[f64; 2]>,
    /// Which metadata and assumptions were used.
    pub evidence: EvidenceUsed,
    /// Wall time by stage.
    pub time_ms: TimeMs,
    /// Matched points, if [`crate::Options::keep_matches`] is set.
    #[serde(skip)]
    pub drawn: Option<Box<MatchedPoints>>,
}

/// A tile of the pack.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TileRef {
    /// Level of the pack, 0 the finest.
    pub level: usize,
    /// Ground resolution of the level, metres per pixel.
    pub gsd_m: f64,
    /// Index in the level.
    pub index: usize,
    /// Similarity of the global descriptors.
    pub similarity: f32,
    /// Votes for one translation; 0 without a vote.
    pub votes: u32,
}

/// The best candidate at another position than the answer's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RunnerUp {
    /// Latitude, degrees north.
    pub lat_deg: f64,
    /// Longitude, degrees east.
    pub lon_deg: f64,
    /// Number of matches that agree with it.
    pub inliers: usize,
}

/// A point of the photo and the point of the map that it was matched with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchedPair {
    /// In the photo.
    pub photo_px: PhotoPx,
    /// On the map.
    pub map_px: MapPx,
    /// Whether the pair agrees with the transform.
    pub is_inlier: bool,
}

/// The matches between the photo and the map.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchedPoints {
    /// The matched points.
    pub pairs: Vec<MatchedPair>,
    /// The tile that was matched.
    pub tile_map_px: WindowPx,
    /// The photo's corners (top left, top right, bottom right, bottom left) on the map; empty without a transform.
    pub outline_map_px: Vec<MapPx>,
}

/// Which metadata and prior values were used.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct EvidenceUsed {
    /// Values that were used.
    pub used: Vec<Evidence>,
    /// Values that were not used.
    pub set_aside: Vec<Evidence>,
    /// What the round of hypotheses that gave the answer assumed.
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

/// An answer without a fix.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NoFix {
    /// The reason.
    pub reason: Reason,
    /// Number of matches of the best candidate that agree with its transform.
    pub inliers: usize,
    /// Number of matches of the best candidate.
    pub matches: usize,
    /// Which metadata and assumptions were used.
    pub evidence: EvidenceUsed,
    /// Wall time by stage.
    pub time_ms: TimeMs,
    /// Matched points of the best candidate, if [`crate::Options::keep_matches`] is set.
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
#[non_exhaustive]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Reason {
    /// The photo has too little texture: water, snow, cloud, night or blur.
    #[error(
        "the photo has too little texture: {found} keypoints (water, snow, cloud, night or blur?)"
    )]
    TooFewKeypoints {
        /// Number of keypoints.
        found: usize,
    },
    /// The photo shows so little ground that it has hardly a pixel of the map's resolution: its height, field of view or ground
    /// resolution are wrong, or the map is far too coarse for it.
    #[error(
        "the photo has {side_px:.0} pixels a side at the map's resolution: check its height, field of view or ground resolution"
    )]
    TooFewPixels {
        /// The square root of the photo's visible area at the resolution of the finest level it was compared with, pixels.
        side_px: f64,
    },
    /// The photo is said to show so much ground that at the map's resolution nothing of it is sharp: its height, field of view or ground
    /// resolution are wrong.
    #[error(
        "one pixel of the photo covers {across_px:.0} of the map's: check its height, field of view or ground resolution"
    )]
    TooMuchGround {
        /// Pixels of the coarsest level it was compared with, across one pixel of the photo.
        across_px: f64,
    },
    /// The compressed data of the photo contradict themselves: parts of it may be shifted, and a position with them.
    #[error("the photo is damaged ({damage}): copy it again from the camera")]
    DamagedPhoto {
        /// What the decoder found.
        damage: Damage,
    },
    /// No tile of the pack is in the given area.
    #[error("the pack has no tile in the given area")]
    NoTiles,
    /// The best candidate does not pass a gate.
    #[error("no position on the map fits well enough: {0}")]
    Rejected(Rejection),
}

/// The gate that an answer does not pass. See [`crate::Gates`] for the limits.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[non_exhaustive]
#[serde(rename_all = "snake_case", tag = "gate")]
pub enum Rejection {
    /// Too few matches agree.
    #[error("{found} matches agree on a position; at least {needed} are required")]
    Inliers {
        /// Number of matches that agree.
        found: usize,
        /// The limit.
        needed: usize,
    },
    /// Too small a share of the matches agrees.
    #[error("too few of the matches agree on a position ({percent:.0} %)")]
    InlierShare {
        /// Share, per cent.
        percent: f64,
    },
    /// The transform is singular or not finite.
    #[error("the transform from photo to map is singular")]
    NotFinite,
    /// The transform mirrors the photo.
    #[error("the transform mirrors the photo")]
    Mirrored,
    /// The scale differs too much from the expected one.
    #[error("the scale is {factor:.2} times the expected one")]
    Scale {
        /// Ratio of the scale to the expected one.
        factor: f64,
    },
    /// The transform shears or stretches the photo too much.
    #[error("the transform shears the photo by {shear:.2}")]
    Shear {
        /// See [`crate::Gates::max_shear`].
        shear: f64,
    },
    /// The perspective of the transform is too strong.
    #[error("the perspective of the transform is too strong ({per_px:.1e} per pixel)")]
    Perspective {
        /// See [`crate::Gates::max_perspective_per_px`].
        per_px: f64,
    },
    /// The photo's centre is outside the map.
    #[error("the photo's centre is outside the map")]
    OutsideMap,
    /// Too small a part of the photo is on the map.
    #[error(
        "only {percent:.0} % of the photo is on the map; at least {needed_percent:.0} % is required"
    )]
    OnMap {
        /// Share of the photo, per cent.
        percent: f64,
        /// The limit.
        needed_percent: f64,
    },
    /// The photo's centre is outside the given area.
    #[error("the photo's centre is outside the given area")]
    OutsideArea,
    /// The inliers are concentrated at a point or along a line.
    #[error(
        "the matches that agree are concentrated at a point or along a line (spread {spread:.2})"
    )]
    Spread {
        /// See [`crate::Gates::min_spread`].
        spread: f64,
    },
    /// The inliers occupy too few grid cells of the photo.
    #[error(
        "the matches that agree occupy {found} grid cells of the photo; at least {needed} are required"
    )]
    Places {
        /// Number of occupied cells.
        found: usize,
        /// See [`crate::Gates::min_places`].
        needed: usize,
    },
    /// Another position fits nearly as well.
    #[error("two positions fit about equally well ({inliers} and {runner_up} matches)")]
    Ambiguous {
        /// Inliers of the best candidate.
        inliers: usize,
        /// Inliers of the best candidate at another position.
        runner_up: usize,
    },
    /// The confidence is too low.
    #[error(
        "confidence {:.1} %; at least {needed_percent:.1} % is required",
        rounded_down(*percent)
    )]
    Confidence {
        /// Confidence, per cent.
        percent: f64,
        /// The limit.
        needed_percent: f64,
    },
}

/// To a tenth, so that a number just below a limit does not read as the limit.
fn rounded_down(percent: f64) -> f64 {
    (percent * 10.0).floor() / 10.0
}

/// Wall time by stage, milliseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TimeMs {
    /// Resampling of the photo.
    pub query: f64,
    /// Inference of the network.
    pub features: f64,
    /// Search by descriptor.
    pub search: f64,
    /// The translation vote.
    pub vote: f64,
    /// Full matching, transform and gates.
    pub matching: f64,
    /// The whole localisation without decoding of the photo.
    pub total: f64,
}

impl TimeMs {
    /// The stages with their names, the total last.
    pub fn stages(&self) -> [(&'static str, f64); 6] {
        [
            ("query", self.query),
            ("features", self.features),
            ("search", self.search),
            ("vote", self.vote),
            ("matching", self.matching),
            ("total", self.total),
        ]
    }
}

impl AddAssign for TimeMs {
    fn add_assign(&mut self, other: Self) {
        self.query += other.query;
        self.features += other.features;
        self.search += other.search;
        self.vote += other.vote;
        self.matching += other.matching;
        self.total += other.total;
    }
}

/// Milliseconds since `start`.
pub(crate) fn elapsed_ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
