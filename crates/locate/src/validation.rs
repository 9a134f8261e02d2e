//! Checks of settings and prior knowledge. Every error names the field, its value and what is expected.

use std::fmt::Display;

use grimnet_net::Model;
use grimnet_pack::Index;
use grimnet_photo::{
    HEADING_RANGE_DEG, HEIGHT_AGL_RANGE_M, HFOV_RANGE_DEG, HeadingPrior, PHOTO_GSD_RANGE_M,
    PITCH_RANGE_DEG, ROLL_RANGE_DEG,
};

use crate::{
    error::{LocateError, Result},
    geometry::ransac::Ransac,
    options::{Gates, MapVoteOptions, Options, VoteOptions},
    prior::Prior,
};

/// Smallest side of a query and width of a photo that the network can use, pixels.
const MIN_SIDE_PX: u32 = 32;
/// Largest number of headings that may be tried.
const MAX_HEADINGS: usize = 360;

/// Largest position error of a map, metres: squares of much more, and radii, are no numbers.
const MAX_MAP_ERROR_M: f64 = 1e5;

const POSITIVE: &str = "a finite number above 0";
const NOT_NEGATIVE: &str = "a finite number, 0 or above";
const SHARE: &str = "a number from 0 to 1";
const COUNT: &str = "at least 1";

impl Options {
    /// Checks that every setting is valid.
    ///
    /// # Errors
    /// Returns [`LocateError::InvalidValue`] for the first setting that is not.
    pub fn check(&self) -> Result<()> {
        let threshold = f64::from(self.keypoint_threshold);
        require("top_k", self.top_k, self.top_k >= 1, COUNT)?;
        if let Some(Index::IvfPq { nprobe, .. }) = self.index {
            require("index.nprobe", nprobe, nprobe >= 1, COUNT)?;
        }
        require_share("keypoint_threshold", threshold)?;
        require(
            "max_keypoints",
            self.max_keypoints,
            self.max_keypoints >= 1,
            COUNT,
        )?;
        for &stage in &self.stages {
            require("stages", stage, stage >= 1, "every stage at least 1")?;
        }
        for (name, count) in [
            ("max_matched", self.max_matched),
            ("first_matched", self.first_matched),
            ("joint_candidates", self.joint_candidates),
            ("joint_matched", self.joint_matched),
        ] {
            require(name, count, count >= 1, COUNT)?;
        }
        if let Some(ratio) = self.max_ratio {
            let holds = ratio > 0.0 && ratio <= 1.0;
            require("max_ratio", ratio, holds, "a number above 0, at most 1")?;
        }
        require(
            "headings",
            self.headings,
            (1..=MAX_HEADINGS).contains(&self.headings),
            "1 to 360",
        )?;
        require(
            "unknown_scales",
            "empty",
            !self.unknown_scales.is_empty(),
            "at least one factor",
        )?;
        for &factor in &self.unknown_scales {
            require("unknown_scales", factor, is_positive(factor), POSITIVE)?;
        }
        for (name, side_px) in [
            ("query_side_px", self.query_side_px),
            ("hypothesis_side_px", self.hypothesis_side_px),
        ] {
            require(name, side_px, side_px >= MIN_SIDE_PX, "at least 32 pixels")?;
        }
        require("finalists", self.finalists, self.finalists >= 1, COUNT)?;
        require(
            "query_width_px",
            self.query_width_px,
            self.query_width_px.is_finite() && self.query_width_px >= f64::from(MIN_SIDE_PX),
            "a finite number, at least 32",
        )?;
        if let Some(budget_ms) = self.budget_ms {
            require("budget_ms", budget_ms, is_positive(budget_ms), POSITIVE)?;
        }
        require(
            "map_error_m",
            self.map_error_m,
            (0.0..=MAX_MAP_ERROR_M).contains(&self.map_error_m),
            "0 to 100000 metres",
        )?;
        self.vote.as_ref().map_or(Ok(()), check_vote)?;
        self.map_vote.as_ref().map_or(Ok(()), check_map_vote)?;
        check_ransac(&self.ransac)?;
        self.gates.as_ref().map_or(Ok(()), check_gates)
    }

    /// Checks that the model states the confidence of which a least one is asked.
    ///
    /// # Errors
    /// [`LocateError::InvalidValue`]: the model is not calibrated, so that the gate would have no effect.
    pub fn check_model(&self, model: &Model) -> Result<()> {
        let least = self.gates.and_then(|gates| gates.min_confidence);
        let least = least.unwrap_or(0.0);
        require(
            "gates.min_confidence",
            least,
            least == 0.0 || model.calibration().confidence.is_some(),
            "0 with a model that states no confidence: it has to be calibrated first",
        )
    }
}

fn check_vote(vote: &VoteOptions) -> Result<()> {
    require("vote.keypoints", vote.keypoints, vote.keypoints >= 1, COUNT)?;
    let bin_px = vote.bin_px;
    let holds = bin_px.is_finite() && bin_px >= 1.0;
    require("vote.bin_px", bin_px, holds, "a finite number, at least 1")?;
    require_not_negative("vote.similarity_votes", vote.similarity_votes)?;
    vote.recount.map_or(Ok(()), |recount| {
        let fewest = recount.candidates.min(recount.keypoints);
        require("vote.recount", fewest, fewest >= 1, COUNT)
    })
}

fn check_map_vote(vote: &MapVoteOptions) -> Result<()> {
    let keypoints = vote.keypoints;
    let holds = (1..=usize::from(u16::MAX)).contains(&keypoints);
    require("map_vote.keypoints", keypoints, holds, "1 to 65535")?;
    for (name, count) in [
        ("map_vote.neighbours", vote.neighbours),
        ("map_vote.lists", vote.lists),
        ("map_vote.places", vote.places),
        ("map_vote.candidates", vote.candidates),
    ] {
        require(name, count, count >= 1, COUNT)?;
    }
    let bin_px = vote.bin_px;
    let holds = bin_px.is_finite() && bin_px >= 1.0;
    require(
        "map_vote.bin_px",
        bin_px,
        holds,
        "a finite number, at least 1",
    )?;
    let similarity_votes = vote.similarity_votes;
    let holds = is_positive(similarity_votes);
    require(
        "map_vote.similarity_votes",
        similarity_votes,
        holds,
        POSITIVE,
    )
}

fn check_ransac(ransac: &Ransac) -> Result<()> {
    let threshold_px = ransac.threshold_px;
    require(
        "ransac.threshold_px",
        threshold_px,
        is_positive(threshold_px),
        POSITIVE,
    )?;
    let max_iterations = ransac.max_iterations;
    require(
        "ransac.max_iterations",
        max_iterations,
        max_iterations >= 1,
        COUNT,
    )?;
    let confidence = ransac.confidence;
    let holds = confidence > 0.0 && confidence <= 1.0;
    require(
        "ransac.confidence",
        confidence,
        holds,
        "a number above 0, at most 1",
    )
}

fn check_gates(gates: &Gates) -> Result<()> {
    for (name, value) in [
        ("gates.max_scale_change", gates.max_scale_change),
        ("gates.max_shear", gates.max_shear),
        ("gates.max_perspective_per_px", gates.max_perspective_per_px),
        ("gates.min_spread", gates.min_spread),
        ("gates.min_margin", gates.min_margin),
    ] {
        require_not_negative(name, value)?;
    }
    require_share("gates.min_inlier_share", gates.min_inlier_share)?;
    require_share("gates.min_on_map", gates.min_on_map)?;
    match gates.min_confidence {
        Some(confidence) => require_share("gates.min_confidence", confidence),
        None => Ok(()),
    }
}

impl Prior {
    /// Checks that every given value is valid.
    ///
    /// # Errors
    /// Returns [`LocateError::InvalidValue`] for the first value that is not.
    pub fn check(&self) -> Result<()> {
        if let HeadingPrior::Known {
            heading_deg,
            sigma_deg,
        } = self.view.heading
        {
            let holds = HEADING_RANGE_DEG.contains(&heading_deg);
            require("heading_deg", heading_deg, holds, "-720 to 720 degrees")?;
            require_not_negative("heading sigma_deg", sigma_deg)?;
        }
        if let Some(pitch_deg) = self.view.pitch_deg {
            let holds = PITCH_RANGE_DEG.contains(&pitch_deg);
            require(
                "pitch_deg",
                pitch_deg,
                holds,
                "-165 to -15 degrees, where -90 is straight down",
            )?;
        }
        if let Some(roll_deg) = self.view.roll_deg {
            let holds = ROLL_RANGE_DEG.contains(&roll_deg);
            require("roll_deg", roll_deg, holds, "-360 to 360 degrees")?;
        }
        if let Some(height_agl_m) = self.view.height_agl_m {
            let holds = HEIGHT_AGL_RANGE_M.contains(&height_agl_m);
            require("height_agl_m", height_agl_m, holds, "2 to 20000 metres")?;
        }
        if let Some(gsd_m) = self.view.gsd_m {
            let holds = PHOTO_GSD_RANGE_M.contains(&gsd_m);
            require("gsd_m", gsd_m, holds, "0.00001 to 1000 metres per pixel")?;
        }
        if let Some(hfov_deg) = self.view.hfov_deg {
            let holds = HFOV_RANGE_DEG.contains(&hfov_deg);
            require("hfov_deg", hfov_deg, holds, "1 to 150 degrees")?;
        }
        if let Some(near) = &self.near {
            let (lat_deg, lon_deg) = (near.centre.lat_deg, near.centre.lon_deg);
            require(
                "near.centre",
                format!("latitude {lat_deg}, longitude {lon_deg}"),
                near.centre.is_valid(),
                "a latitude from -90 to 90 degrees and a finite longitude",
            )?;
            let radius_m = near.radius_m;
            require("near.radius_m", radius_m, is_positive(radius_m), POSITIVE)?;
        }
        Ok(())
    }
}

fn is_positive(value: f64) -> bool {
    value > 0.0 && value.is_finite()
}

fn require_not_negative(name: &'static str, value: f64) -> Result<()> {
    require(name, value, value >= 0.0 && value.is_finite(), NOT_NEGATIVE)
}

fn require_share(name: &'static str, value: f64) -> Result<()> {
    require(name, value, (0.0..=1.0).contains(&value), SHARE)
}

fn require(
    field: &'static str,
    value: impl Display,
    holds: bool,
    expected: &'static str,
) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(LocateError::InvalidValue {
        field,
        value: value.to_string(),
        expected,
    })
}

#[cfg(test)]
mod tests;
