//! What a page shows besides an answer.

use std::io::Cursor;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use grimnet_answer::Answer;
use grimnet_locate::draw::{DrawOptions, draw_matches};
use grimnet_locate::{MatchedPoints, Outcome, Prior};
use grimnet_photo::Photo;
use image::ImageFormat;
use serde::Serialize;

use crate::maps::ServedMap;

/// An answer, with its details if they were asked for.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct DetailedAnswer {
    #[serde(flatten)]
    pub answer: Answer,
    /// What was assumed and found besides the answer; only with `detail=true`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detail: Option<Detail>,
}

/// What was assumed and found besides the answer.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct Detail {
    /// Id of the map.
    map: String,
    /// Heading from the prior or the metadata, degrees clockwise from true north.
    heading_deg: Option<f64>,
    /// Pitch of the camera from the prior or the metadata, degrees; -90 is straight down.
    pitch_deg: Option<f64>,
    /// Height above ground from the prior or the metadata, metres.
    height_agl_m: Option<f64>,
    /// Horizontal field of view from the prior or the metadata, degrees.
    hfov_deg: Option<f64>,
    /// Longitude and latitude of the best candidate at another place, degrees.
    runner_up_lon_lat_deg: Option<[f64; 2]>,
    /// A picture (JPEG in base64) of the photo and the map with the matches between them; `null` if nothing was matched.
    matches_jpeg_base64: Option<String>,
}

impl Detail {
    /// The details of what localisation found for a photo.
    pub(crate) fn of(map: &ServedMap, photo: &Photo, prior: &Prior, outcome: &Outcome) -> Self {
        let view = photo.view(&prior.view);
        let matched = match outcome {
            Outcome::Fix(fix) => fix.drawn.as_deref(),
            Outcome::NoFix(no_fix) => no_fix.drawn.as_deref(),
        };
        let runner_up = outcome.fix().and_then(|fix| fix.runner_up);
        Self {
            map: map.id().to_owned(),
            heading_deg: view.heading.map(|heading| heading.heading_deg),
            pitch_deg: view.attitude.map(|camera| camera.gimbal_pitch_deg()),
            height_agl_m: view.height_agl_m,
            hfov_deg: view.hfov_deg,
            runner_up_lon_lat_deg: runner_up.map(|at| [at.lon_deg, at.lat_deg]),
            matches_jpeg_base64: matched.and_then(|matched| matches_jpeg(map, photo, matched)),
        }
    }
}

/// The matches as a JPEG in base64. `None` if they cannot be drawn: the answer is worth more than a picture.
fn matches_jpeg(map: &ServedMap, photo: &Photo, matched: &MatchedPoints) -> Option<String> {
    let options = DrawOptions::default();
    let picture = draw_matches(photo, matched, map.raster.as_deref(), &options)
        .inspect_err(|error| tracing::warn!(%error, "matches cannot be drawn"))
        .ok()?;
    let mut jpeg = Cursor::new(Vec::new());
    picture
        .write_to(&mut jpeg, ImageFormat::Jpeg)
        .inspect_err(|error| tracing::warn!(%error, "matches cannot be encoded"))
        .ok()?;
    Some(STANDARD.encode(jpeg.into_inner()))
}
