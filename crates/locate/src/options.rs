//! The settings of the localiser, with their two named sets: [`Options::default`] and [`Options::paper`].

use grimnet_pack::{Index, Mode};
use serde::{Deserialize, Serialize};

use crate::geometry::{
    estimation::{EstimationOptions, GeometryModel},
    ransac::{Ransac, Score},
    sampler::Sampling,
};

/// Which candidate wins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Choice {
    /// The largest number of inliers.
    Inliers,
    /// The largest inliers / (matches + 1) (paper, eq. 20).
    InlierRatio,
}

/// How map pixels become degrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinates {
    /// By the map's affine transform and coordinate reference system.
    Georeference,
    /// By linear interpolation between the map's lower left and upper right corners (paper, eq. 2a, 2b and 23). Paper
    /// mode only. Wrong by metres to hundreds of metres on maps whose columns are not meridians, such as most in UTM.
    PaperCorners,
}

/// Whether batch-normalisation statistics are recomputed from the photos, without labels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Adapt {
    /// Use the statistics of the model.
    #[default]
    None,
    /// Recompute them for each photo from the photo itself.
    Photo,
    /// They were recomputed from the photos of a flight by [`crate::Localizer::adapted_to_flight`], which sets this; without it this is
    /// as `None`. This is the only setting with which an answer depends on other photos.
    Flight,
}

/// The translation vote that ranks candidates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VoteOptions {
    /// Number of strongest keypoints of the query and of the tile that take part.
    pub keypoints: usize,
    /// Side of a bin of the histogram, pixels. The peak is the fullest square of 2 x 2 bins.
    pub bin_px: f64,
    /// Number of votes that a similarity of 1 of the global descriptors is worth. Both are evidence for a tile, and on a map of
    /// thousands of tiles some get as many votes by chance as the right one.
    pub similarity_votes: f64,
    /// A second vote with more keypoints, among the best of a stage in which more candidates enter than are matched in full, and of many
    /// ground widths among the best of all that have entered.
    pub recount: Option<Recount>,
}

/// The second vote.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recount {
    /// Number of candidates that take part, best by the first vote; the others are not matched.
    pub candidates: usize,
    /// Number of strongest keypoints of the query and of the tile that take part.
    pub keypoints: usize,
}

impl Default for VoteOptions {
    fn default() -> Self {
        Self {
            keypoints: 256,
            bin_px: 24.0,
            similarity_votes: 15.0,
            recount: Some(Recount {
                candidates: 512,
                keypoints: 512,
            }),
        }
    }
}

/// The vote over a whole map, by which candidates are found beside the tiles' descriptors where the pack has an index of its
/// keypoints: on maps of many tiles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapVoteOptions {
    /// Stage of the cascade before which the map is voted over: 1 for photos without a clear answer among the most similar tiles, 0 for
    /// all.
    pub stage: usize,
    /// Number of strongest keypoints of the query that take part.
    pub keypoints: usize,
    /// Number of most similar keypoints of the map that each votes with.
    pub neighbours: usize,
    /// Lists of the index that are visited for each.
    pub lists: usize,
    /// Side of a bin of positions, level pixels. Votes are counted in squares of 2 x 2 bins.
    pub bin_px: f64,
    /// Number of places with the most votes that become candidates, per hypothesis of heading and scale.
    pub places: usize,
    /// Number of votes that a similarity of 1 of the global descriptors is worth when candidates are ordered.
    pub similarity_votes: f64,
    /// Number of candidates, best by both, that the later stages are made of. The others never enter.
    pub candidates: usize,
}

impl Default for MapVoteOptions {
    fn default() -> Self {
        Self {
            stage: 1,
            keypoints: 512,
            neighbours: 64,
            lists: 6,
            bin_px: 32.0,
            places: 200,
            similarity_votes: 12.0,
            candidates: 4000,
        }
    }
}

/// Limits that a transform must keep to become a fix.
///
/// With a calibrated model the confidence judges the support, and `min_inliers`, `min_places` and `min_margin` are not applied
/// ([`Gates::with_calibration`]). A runner-up with 45 inliers or more is another place that looks alike: it needs a margin of 1.25 always.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gates {
    /// Minimum number of inliers.
    pub min_inliers: usize,
    /// Largest deviation of the scale from the expected one, as a factor in both directions: 0.35 allows 1 / 1.35 to 1.35.
    pub max_scale_change: f64,
    /// Largest difference of the two principal scales at the photo's centre over their geometric mean. For a pure shear this is
    /// the shear.
    pub max_shear: f64,
    /// Largest length of the homography's perspective row relative to its value at the photo's centre, per pixel.
    pub max_perspective_per_px: f64,
    /// Minimum standard deviation of the inliers along their short axis, over half the photo's mean side.
    pub min_spread: f64,
    /// Minimum number of grid cells of the photo that hold inliers. A cell is a twelfth of the photo's mean side wide.
    pub min_places: usize,
    /// Minimum share of the matches that are inliers, 0 to 1.
    pub min_inlier_share: f64,
    /// Minimum ratio of the inliers to those of the best candidate at another position.
    pub min_margin: f64,
    /// Minimum share of the photo that lies on the map, 0 to 1.
    pub min_on_map: f64,
    /// Whether a fix must have at least the confidence that the model's calibration requires, if the model is calibrated.
    pub by_confidence: bool,
    /// Required confidence, 0 to 1; `None` for the one of the model's calibration.
    pub min_confidence: Option<f64>,
}

impl Default for Gates {
    fn default() -> Self {
        Self {
            min_inliers: 20,
            max_scale_change: 0.35,
            max_shear: 0.25,
            max_perspective_per_px: 1e-3,
            min_spread: 0.12,
            min_places: 15,
            min_inlier_share: 0.0,
            min_margin: 1.25,
            min_on_map: 0.5,
            by_confidence: true,
            min_confidence: None,
        }
    }
}

/// Fewest inliers that any answer has where the confidence judges the support: a homography with two spare matches.
const MIN_CALIBRATED_INLIERS: usize = 6;

impl Gates {
    /// The limits with a calibrated model: those on the number, the cells and the lead of the inliers are left to the confidence,
    /// which weighs them together.
    #[must_use]
    pub fn with_calibration(self) -> Self {
        if !self.by_confidence {
            return self;
        }
        Self {
            min_inliers: MIN_CALIBRATED_INLIERS,
            min_places: 0,
            min_margin: 0.0,
            ..self
        }
    }
}

/// Assumed registration error of a map, metres, 1-sigma per axis. National orthophotos (20 to 40 cm per pixel) usually have two to
/// three pixels per axis (ASPRS Positional Accuracy Standards for Digital Geospatial Data, 2014, table B.5); satellite layers of
/// web maps are often worse, a map surveyed by a drone is often better.
pub const DEFAULT_MAP_ERROR_M: f64 = 1.0;

/// How a photo is localised.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "snake_case")]
pub struct Options {
    /// The procedure. In paper mode the whole photo is resized to the network's resolution, heading and scale are neither used
    /// nor searched, and the pack must be built in paper mode.
    pub mode: Mode,
    /// Maximum number of tiles found by descriptor, per hypothesis of heading and scale.
    pub top_k: usize,
    /// How tile descriptors are searched; `None` for the index that the pack was built with.
    pub index: Option<Index>,
    /// The vote of local descriptors over the whole map, if the pack has an index of its keypoints; `None` for none.
    pub map_vote: Option<MapVoteOptions>,
    /// Minimum probability of the photo's keypoints.
    pub keypoint_threshold: f32,
    /// Maximum number of the photo's keypoints.
    pub max_keypoints: usize,
    /// Radius of non-maximum suppression of keypoints, pixels.
    pub nms_radius_px: u32,
    /// The translation vote that ranks candidates before any is matched in full; `None` keeps the order of the search.
    pub vote: Option<VoteOptions>,
    /// Number of candidates that enter each stage of the cascade, best by descriptor first. The rest enter in a last stage.
    pub stages: Vec<usize>,
    /// Maximum number of candidates that are matched in full per stage.
    pub max_matched: usize,
    /// Maximum number of candidates that are matched in full in the first stage if several ground widths are tried, before the
    /// next is. The others are matched later if no answer is clear.
    pub first_matched: usize,
    /// Number of candidates that enter after the first stage if many ground widths are tried, the most similar of all widths. There is
    /// no later stage then.
    pub joint_candidates: usize,
    /// Maximum number of candidates that are matched in full after the first look at each of many ground widths: half of them before
    /// the joint candidates enter, from the first stage of each width.
    pub joint_matched: usize,
    /// Minimum number of candidates that are matched in full before a clear answer ends the search.
    pub min_matched: usize,
    /// An answer with this many inliers, and twice as many as any at another position, ends the search, once candidates elsewhere that
    /// have half of its votes, at most 16, were matched besides.
    pub clear_inliers: usize,
    /// Lowe's ratio test: largest ratio of the distances to the nearest and the second nearest descriptor; `None` for no test.
    pub max_ratio: Option<f32>,
    /// Settings of RANSAC.
    pub ransac: Ransac,
    /// The order in which RANSAC draws samples.
    pub sampling: Sampling,
    /// Seed of the samples that RANSAC draws.
    pub seed: u64,
    /// The kind of transform from photo to map.
    pub geometry: GeometryModel,
    /// Whether to match again around the positions that the first transform predicts (guided matching).
    pub guided: bool,
    /// Whether to refine the transform with each pair weighted by the probability of its keypoint.
    pub refine: bool,
    /// Paper mode: whether a photo is first turned by its heading, if that is known, so that the map's up is up. The paper uses no
    /// heading.
    pub turn_by_heading: bool,
    /// Which candidate wins.
    pub choice: Choice,
    /// Limits that a transform must keep to become a fix; `None` answers always.
    pub gates: Option<Gates>,
    /// How map pixels become degrees.
    pub coordinates: Coordinates,
    /// Batch-normalisation statistics for the photos.
    pub adapt: Adapt,
    /// Number of evenly spaced headings that are tried if the heading is unknown; 12 is one every 30 degrees.
    pub headings: usize,
    /// Ground widths that are tried if none is known, or after an uncertain one, as factors on the width of a tile, for each level of the pack.
    pub unknown_scales: Vec<f64>,
    /// Largest side of a query, cropped around the photo's centre, pixels.
    pub query_side_px: u32,
    /// Largest side of a query if several headings are tried, pixels. The best answer is matched again at `query_side_px`.
    pub hypothesis_side_px: u32,
    /// Whether an answer is matched again with the photo rotated and scaled accordingly, if it deviates from its hypothesis.
    pub realign: bool,
    /// Number of best answers at different positions that are matched again if none is clear. The best of them wins.
    pub finalists: usize,
    /// Desired width of the photo in level pixels; the level with the nearest resolution is used.
    pub query_width_px: f64,
    /// Time after which the search stops and answers with what it found, milliseconds. With a limit the answers depend on the
    /// speed of the machine.
    pub budget_ms: Option<f64>,
    /// Registration error of the map, metres, 1-sigma per axis. It is added to the stated covariance, since no photo can reveal
    /// it. See [`DEFAULT_MAP_ERROR_M`].
    pub map_error_m: f64,
    /// Whether the answer holds the matched points, for drawing.
    pub keep_matches: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            mode: Mode::Default,
            top_k: 1000,
            index: None,
            map_vote: Some(MapVoteOptions::default()),
            keypoint_threshold: 0.005,
            max_keypoints: 1024,
            nms_radius_px: 2,
            vote: Some(VoteOptions::default()),
            stages: vec![64, 1000],
            max_matched: 64,
            first_matched: 8,
            joint_candidates: 6000,
            joint_matched: 128,
            min_matched: 3,
            clear_inliers: 45,
            max_ratio: None,
            ransac: Ransac {
                threshold_px: 5.0,
                max_iterations: 1000,
                confidence: 0.999,
                score: Score::Truncated,
                local_optimisation: true,
                needs_support: true,
            },
            sampling: Sampling::Progressive,
            seed: 1,
            geometry: GeometryModel::SimilarityThenHomography,
            guided: true,
            refine: true,
            turn_by_heading: false,
            choice: Choice::Inliers,
            gates: Some(Gates::default()),
            coordinates: Coordinates::Georeference,
            adapt: Adapt::None,
            headings: 12,
            unknown_scales: vec![0.95, 0.67],
            query_side_px: 512,
            hypothesis_side_px: 384,
            realign: true,
            finalists: 4,
            query_width_px: 448.0,
            budget_ms: None,
            map_error_m: DEFAULT_MAP_ERROR_M,
            keep_matches: false,
        }
    }
}

impl Options {
    /// The settings of transform estimation, for a heading that is known to `max_rotation_rad`.
    #[doc(hidden)]
    pub fn estimation(&self, max_rotation_rad: f64) -> EstimationOptions {
        EstimationOptions {
            model: self.geometry,
            ransac: self.ransac,
            sampling: self.sampling,
            seed: self.seed,
            refine: self.refine,
            max_scale: self
                .gates
                .map_or(f64::INFINITY, |gates| 1.0 + gates.max_scale_change),
            max_rotation_rad,
            scale_prior: None,
        }
    }
}
