//! `POST /v1/locate`: where a photo was taken.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use grimnet_answer::{Answer, text_of};
use grimnet_locate::draw::{DrawOptions, draw_matches};
use grimnet_locate::{LocateError, NeededPixels, Outcome, Prior};
use grimnet_photo::{Photo, PhotoError};
use image::ImageFormat;
use serde::Serialize;

use crate::accept::AnswerType;
use crate::limits::Limits;
use crate::maps::ServedMap;
use crate::prior_fields::PriorFields;
use crate::problem::Problem;
use crate::query::Query;
use crate::state::{Shared, State};
use crate::upload::{Upload, label};

/// What an answer can be; JSON unless the client says otherwise.
const OFFERED: [AnswerType; 6] = [
    AnswerType::Json,
    AnswerType::JsonLines,
    AnswerType::Geojson,
    AnswerType::Kml,
    AnswerType::Gpx,
    AnswerType::Csv,
];

/// What photos without a name are called.
const NO_NAME: &str = "photo";

/// An answer with what a page shows besides.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub(crate) struct DetailedAnswer {
    #[serde(flatten)]
    answer: Answer,
    /// Details of the answer.
    detail: Detail,
}

/// What was assumed and found besides the answer.
#[derive(Debug, Serialize, utoipa::ToSchema)]
struct Detail {
    /// The map.
    map: String,
    /// Heading that the prior or the metadata tell, degrees clockwise from true north.
    heading_deg: Option<f64>,
    /// Height above ground that the prior or the metadata tell, metres.
    height_agl_m: Option<f64>,
    /// Horizontal field of view that the prior or the metadata tell, degrees.
    hfov_deg: Option<f64>,
    /// Longitude and latitude of the best candidate at another place, degrees.
    runner_up_lon_lat_deg: Option<[f64; 2]>,
    /// A picture (JPEG in base64) of the photo and the map with the matches between them.
    matches_jpeg_base64: Option<String>,
}

/// Finds where a photo was taken
///
/// The body is `multipart/form-data` with the photo as `photo` and what is known of it as `prior` (JSON), or the photo itself,
/// with what is known of it as query parameters. A photo without a fix is answered with status 200 and `state` `no_fix`.
#[utoipa::path(
    post,
    path = "/v1/locate",
    tag = "locate",
    params(
        ("map" = Option<String>, Query, description = "Which map; it may be left out if there is only one"),
        ("name" = Option<String>, Query, description = "Name of the photo in the answer"),
        ("detail" = Option<bool>, Query, description = "Adds `detail` to a JSON answer: what was assumed, the runner-up and a picture of the matches"),
        ("heading" = Option<String>, Query, description = "As in Prior"),
        ("heading_sigma_deg" = Option<f64>, Query, description = "As in Prior"),
        ("height_agl_m" = Option<f64>, Query, description = "As in Prior"),
        ("hfov_deg" = Option<f64>, Query, description = "As in Prior"),
        ("gsd_m" = Option<f64>, Query, description = "As in Prior"),
        ("near" = Option<String>, Query, description = "LAT,LON,RADIUS_M: search only here"),
    ),
    request_body(content(
        (crate::openapi::LocateForm = "multipart/form-data"),
        (crate::openapi::Binary = "image/jpeg"),
        (crate::openapi::Binary = "image/png"),
        (crate::openapi::Binary = "image/tiff"),
        (crate::openapi::Binary = "image/webp"),
        (crate::openapi::Binary = "application/octet-stream"),
    )),
    responses(
        (status = 200, description = "The answer", content(
            (DetailedAnswer = "application/json"),
            (DetailedAnswer = "application/x-ndjson"),
            (String = "application/geo+json"),
            (String = "application/vnd.google-earth.kml+xml"),
            (String = "application/gpx+xml"),
            (String = "text/csv"),
        )),
        (status = "4XX", description = "The request cannot be answered", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The service is busy: see Retry-After", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(crate) async fn locate(
    axum::extract::State(state): Shared,
    uri: Uri,
    headers: HeaderMap,
    request: Request,
) -> Result<Response, Problem> {
    let kind = AnswerType::accepted(&headers, &OFFERED)?;
    let mut query = Query::of(&uri)?;
    let map = query.take("map");
    state.maps.get_or_only(map.as_deref())?;
    let name = query.take("name");
    let detailed = query.take_bool("detail")?;
    let place = state.admission.enter()?;
    let upload = Upload::read(request, &state.limits).await?;
    let prior = prior_of(&query, upload.prior.as_ref())?;
    let name = name.as_deref().and_then(label).or(upload.name);
    let question = Question {
        photo: upload.photo,
        name: name.unwrap_or_else(|| NO_NAME.to_owned()),
        prior,
        detailed,
        kind,
    };
    let shared = state.clone();
    let work = move || {
        let map = shared.maps.get_or_only(map.as_deref())?;
        question.answer(&shared, map)
    };
    let text = place.run(&state.limits, work).await??;
    let content_type = HeaderValue::from_static(kind.media_type());
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
}

/// The prior from the body or from the query, not from both.
pub(crate) fn prior_of(query: &Query, part: Option<&PriorFields>) -> Result<Prior, Problem> {
    match part {
        Some(_) if !query.is_empty() => Err(Problem::bad_request(
            "the prior is given as a part of the body and in the query; expected one of them",
        )),
        Some(fields) => fields.prior(),
        None => PriorFields::from_pairs(query.pairs())?.prior(),
    }
}

/// One photo to localise.
struct Question {
    photo: Vec<u8>,
    name: String,
    prior: Prior,
    detailed: bool,
    kind: AnswerType,
}

impl Question {
    /// Decodes and localises the photo, and writes the answer. This takes long.
    fn answer(self, state: &Arc<State>, map: &ServedMap) -> Result<String, Problem> {
        let start = Instant::now();
        let needed = map.localizer.needed_pixels(&self.prior);
        let photo = decode(needed, &self.name, &self.photo, &state.limits)?;
        drop(self.photo);
        let outcome = map
            .localizer
            .locate(&photo, &self.prior)
            .map_err(|error| problem_of_locate(&error))?;
        let is_fix = outcome.fix().is_some();
        state.metrics.answer(map.id(), is_fix, start.elapsed());
        tracing::info!(
            map = map.id(),
            state = if is_fix { "fix" } else { "no_fix" },
            ms = start.elapsed().as_millis() as u64,
            "localised"
        );
        let answer = Answer::of(&self.name, &outcome);
        let is_json = matches!(self.kind, AnswerType::Json | AnswerType::JsonLines);
        let text = if self.detailed && is_json {
            let detail = detail(map, &photo, &self.prior, &outcome);
            serde_json::to_string(&DetailedAnswer { answer, detail }).map(|line| line + "\n")
        } else {
            return text_of(self.kind.format().as_mut(), [&answer]).map_err(|error| {
                tracing::error!(%error, "an answer cannot be written");
                Problem::internal()
            });
        };
        text.map_err(|error| {
            tracing::error!(%error, "an answer cannot be written");
            Problem::internal()
        })
    }
}

/// Decodes a photo at the size that localisation needs.
pub(crate) fn decode(
    needed: NeededPixels,
    name: &str,
    bytes: &[u8],
    limits: &Limits,
) -> Result<Photo, Problem> {
    needed
        .decode(name, bytes, &limits.photo)
        .map_err(|error| problem_of_photo(&error))
}

fn detail(map: &ServedMap, photo: &Photo, prior: &Prior, outcome: &Outcome) -> Detail {
    let view = photo.view(&prior.view);
    let drawn = match outcome {
        Outcome::Fix(fix) => fix.drawn.as_deref(),
        Outcome::NoFix(no_fix) => no_fix.drawn.as_deref(),
    };
    let runner_up = outcome.fix().and_then(|fix| fix.runner_up);
    Detail {
        map: map.id().to_owned(),
        heading_deg: view.heading.map(|heading| heading.heading_deg),
        height_agl_m: view.height_agl_m,
        hfov_deg: view.hfov_deg,
        runner_up_lon_lat_deg: runner_up.map(|at| [at.lon_deg, at.lat_deg]),
        matches_jpeg_base64: drawn.and_then(|drawn| {
            let picture =
                draw_matches(photo, drawn, map.raster.as_deref(), &DrawOptions::default());
            let mut jpeg = std::io::Cursor::new(Vec::new());
            let written = picture
                .map_err(|error| error.to_string())
                .and_then(|picture| {
                    picture
                        .write_to(&mut jpeg, ImageFormat::Jpeg)
                        .map_err(|error| error.to_string())
                });
            match written {
                Ok(()) => Some(base64::engine::general_purpose::STANDARD.encode(jpeg.into_inner())),
                // The answer is worth more than a picture.
                Err(error) => {
                    tracing::warn!(error, "matches cannot be drawn");
                    None
                }
            }
        }),
    }
}

fn problem_of_photo(error: &PhotoError) -> Problem {
    match error {
        PhotoError::Unsupported { .. } => Problem::unsupported(error),
        PhotoError::TooLarge { .. } | PhotoError::FileTooLarge { .. } => Problem::too_large(error),
        PhotoError::Empty { .. }
        | PhotoError::Truncated { .. }
        | PhotoError::Corrupt { .. }
        | PhotoError::TooSmall { .. }
        | PhotoError::Horizon { .. }
        | PhotoError::BadRequest { .. } => Problem::bad_value(error),
        _ => {
            tracing::error!(%error, "a photo cannot be read");
            Problem::internal()
        }
    }
}

fn problem_of_locate(error: &LocateError) -> Problem {
    match error {
        LocateError::Photo(error) => problem_of_photo(error),
        LocateError::InvalidValue { .. } => Problem::bad_value(error),
        _ => {
            tracing::error!(%error, "a localisation failed");
            Problem::internal()
        }
    }
}
