//! Every decision of the localiser as a setting, and the two named sets: what the paper does, and what serves a user best.

use serde::{Deserialize, Serialize};

use crate::{
    error::{LocateError, Result},
    gates::Gates,
    ransac::{Ransac, Score},
    vote::VoteOptions,
};

/// The two named sets of settings.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// What a user is best served by.
    #[default]
    Default,
    /// The paper's recipe to the letter.
    Paper,
}

/// How tile descriptors are searched.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Search {
    /// With the index that the pack was built with.
    #[default]
    AsBuilt,
    /// Every tile is compared.
    Exact,
    /// Inverted lists with product quantisation; the pack must hold them.
    IvfPq {
        /// Lists visited.
        nprobe: usize,
        /// Candidates per answer ranked again by full vectors; 0: none.
        rerank_factor: usize,
    },
}

/// The transform from photo to map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GeometryModel {
    /// Rotation, scale and translation only.
    Similarity,
    /// A similarity first; a homography in its place where the matches support one.
    SimilarityThenHomography,
    /// A homography from the start, as in the paper.
    Homography,
}

/// Which candidate wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Choice {
    /// The largest number of inliers.
    Inliers,
    /// The largest inliers / (matches + 1), as in the paper.
    InlierRatio,
}

/// How pixels of the map become degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinates {
    /// By the map's affine transform and coordinate system.
    Georeference,
    /// Linearly between the map's lower left and upper right corner (the paper's equations 22 and 23).
    PaperCorners,
}

/// Whether normalisation statistics are taken anew, without labels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Adapt {
    /// The model's own.
    #[default]
    None,
    /// Of each photo over itself.
    Photo,
    /// Of a flight over its photos, see [`crate::Localizer::adapted_to_flight`]. The only setting under which an answer depends
    /// on other photos.
    Flight,
}

/// Registration error that a map is taken to have, metres, 1-sigma per axis. Of national orthophotos (20 to 40 cm a pixel) two to
/// three pixels per axis are usual (ASPRS Positional Accuracy Standards for Digital Geospatial Data, 2014, table B.5); satellite
/// layers of web maps are often worse, a survey's own map better.
pub const DEFAULT_MAP_ERROR_M: f64 = 1.0;

/// How a photo is localised. [`Options::default`] and [`Options::paper`] are the named sets.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "snake_case")]
pub struct Options {
    /// Which set these began as. In paper mode the whole photo is resized to the network's resolution, heading and scale are
    /// neither used nor searched, and the pack must be built in paper mode.
    pub mode: Mode,
    /// Tiles taken from the search by descriptor, per hypothesis of heading and scale.
    pub top_k: usize,
    /// How tile descriptors are searched.
    pub search: Search,
    /// The photo's keypoints are at least this probable.
    pub keypoint_threshold: f32,
    /// The photo's keypoints at most.
    pub max_keypoints: usize,
    /// A keypoint is the most probable within this distance, pixels.
    pub nms_radius_px: u32,
    /// Ranks the tiles found by a vote over translations before any is matched in full; none keeps the order of the search.
    pub vote: Option<VoteOptions>,
    /// Candidates that enter each stage of a round, best by descriptor first; what is left after these makes the last stage.
    pub stages: Vec<usize>,
    /// Candidates matched in full at most, per stage of a round.
    pub max_matched: usize,
    /// Candidates matched in full at least, so that a runner-up is known.
    pub min_matched: usize,
    /// No further candidate is matched once one passes the gates with this many inliers.
    pub clear_inliers: usize,
    /// Lowe's ratio; none for mutual nearest neighbours alone.
    pub max_ratio: Option<f32>,
    /// Search for the transform.
    pub ransac: Ransac,
    /// Seed of its samples.
    pub seed: u64,
    /// The transform.
    pub geometry: GeometryModel,
    /// Looks for more matches near where the transform puts each keypoint, and fits it to them.
    pub guided: bool,
    /// Refines the transform with each pair weighted by its keypoint's probability.
    pub refine: bool,
    /// Which candidate wins.
    pub choice: Choice,
    /// When a transform is not believed; none answers always.
    pub gates: Option<Gates>,
    /// How pixels of the map become degrees.
    pub coordinates: Coordinates,
    /// Normalisation statistics of the photo.
    pub adapt: Adapt,
    /// Rotations tried where the heading is unknown, evenly spread; 12 is one every 30 degrees.
    pub headings: usize,
    /// Factors on the believed ground width that are tried one after the other where it is doubtful, after 1.
    pub doubtful_scales: Vec<f64>,
    /// Factors on a tile's width that are taken for the photo's where nothing is known of it, per level of the pack.
    pub unknown_scales: Vec<f64>,
    /// Queries are cropped to this side about the photo's centre, pixels.
    pub query_side_px: u32,
    /// Queries whose heading is only a hypothesis are cropped to this side; one is made again at the size above around the
    /// best answer.
    pub hypothesis_side_px: u32,
    /// Matches again with the photo turned and scaled as the first answer says, where that differs by much.
    pub realign: bool,
    /// The photo's width in pixels of the level that suits it best; the nearest level is taken.
    pub query_width_px: f64,
    /// Stop after this time and answer with what was found, milliseconds. Answers then depend on the machine's speed.
    pub budget_ms: Option<f64>,
    /// How far the map itself may lie beside the truth, metres, 1-sigma per axis: its registration, which no photo can tell.
    /// Added to the stated covariance. [`DEFAULT_MAP_ERROR_M`] unless it is known better.
    pub map_error_m: f64,
    /// Keeps the matched points in the answer, for drawing.
    pub keep_matches: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            mode: Mode::Default,
            top_k: 300,
            search: Search::AsBuilt,
            keypoint_threshold: 0.005,
            max_keypoints: 1024,
            nms_radius_px: 2,
            vote: Some(VoteOptions::default()),
            stages: vec![64, 448],
            max_matched: 12,
            min_matched: 3,
            clear_inliers: 45,
            max_ratio: None,
            ransac: Ransac {
                threshold_px: 5.0,
                max_iterations: 1000,
                confidence: 0.999,
                score: Score::Truncated,
                local_optimisation: true,
            },
            seed: 1,
            geometry: GeometryModel::SimilarityThenHomography,
            guided: true,
            refine: true,
            choice: Choice::Inliers,
            gates: Some(Gates::default()),
            coordinates: Coordinates::Georeference,
            adapt: Adapt::None,
            headings: 12,
            doubtful_scales: vec![0.75, 1.33],
            unknown_scales: vec![0.95, 0.67],
            query_side_px: 512,
            hypothesis_side_px: 384,
            realign: true,
            query_width_px: 448.0,
            budget_ms: None,
            map_error_m: DEFAULT_MAP_ERROR_M,
            keep_matches: false,
        }
    }
}

impl Options {
    /// The paper's recipe: the whole photo at the network's resolution, top 5 by descriptor, ratio 0.8, RANSAC-DLT with 4 px and
    /// 1000 iterations, weighted refinement, the largest inliers / (matches + 1), always an answer.
    pub fn paper() -> Self {
        Self {
            mode: Mode::Paper,
            top_k: 5,
            search: Search::AsBuilt,
            keypoint_threshold: 0.015,
            max_keypoints: 1024,
            vote: None,
            max_matched: 5,
            min_matched: 5,
            clear_inliers: usize::MAX,
            max_ratio: Some(0.8),
            ransac: Ransac::PAPER,
            geometry: GeometryModel::Homography,
            choice: Choice::InlierRatio,
            gates: None,
            coordinates: Coordinates::PaperCorners,
            guided: false,
            realign: false,
            ..Self::default()
        }
    }

    /// Checks that the settings mean something.
    ///
    /// # Errors
    /// [`LocateError::BadOption`] names the first that does not.
    pub fn check(&self) -> Result<()> {
        let is_positive = |value: f64| value > 0.0 && value.is_finite();
        let side_px = self.hypothesis_side_px.min(self.query_side_px);
        let bin_px = self.vote.map_or(1.0, |vote| vote.bin_px);
        demand(
            "query_width_px",
            self.query_width_px,
            self.query_width_px.is_finite() && self.query_width_px >= 32.0,
            "must be at least 32",
        )?;
        demand(
            "ransac.threshold_px",
            self.ransac.threshold_px,
            is_positive(self.ransac.threshold_px),
            "must be a number above zero",
        )?;
        demand(
            "hypothesis_side_px or query_side_px",
            side_px,
            side_px >= 32,
            "must be at least 32",
        )?;
        demand(
            "top_k or max_matched",
            self.top_k.min(self.max_matched),
            self.top_k > 0 && self.max_matched > 0,
            "must be at least 1",
        )?;
        demand(
            "vote.bin_px",
            bin_px,
            bin_px >= 1.0 && bin_px.is_finite(),
            "must be at least 1",
        )
    }
}

fn demand(
    name: &'static str,
    value: impl std::fmt::Display,
    holds: bool,
    expected: &'static str,
) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(LocateError::BadOption {
        name,
        value: value.to_string(),
        expected,
    })
}
