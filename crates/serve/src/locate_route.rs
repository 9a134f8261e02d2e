//! `POST /v1/locate`: where a photo was taken.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, Uri, header};
use axum::response::{IntoResponse, Response};
use grimnet_answer::{Answer, text_of};
use grimnet_locate::{LocateError, Prior};

use crate::answer_detail::{Detail, DetailedAnswer};
use crate::answer_type::AnswerType;
use crate::maps::ServedMap;
use crate::photo::{decode, problem_of_photo};
use crate::problem::Problem;
use crate::query::Query;
use crate::state::{Shared, State};
use crate::upload::Upload;

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

/// Finds where a photo was taken
///
/// The body is `multipart/form-data` with the photo as `photo` and what is known of it as `prior` (JSON), or the photo itself,
/// with what is known of it as query parameters. A photo without a fix is answered with status 200 and `state` `no_fix`. `null` is
/// what is not known.
#[utoipa::path(
    post,
    path = "/v1/locate",
    tag = "locate",
    params(
        ("map" = Option<String>, Query, description = "Which map; it may be left out if there is only one"),
        ("name" = Option<String>, Query, description = "Name of the photo in the answer"),
        ("detail" = Option<bool>, Query, description = "Adds `detail` to a JSON answer: what was assumed, the runner-up and a picture of the matches"),
        crate::prior_fields::PriorFields,
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
            (crate::openapi::GeoJson = "application/geo+json"),
            (String = "application/vnd.google-earth.kml+xml"),
            (String = "application/gpx+xml"),
            (String = "text/csv"),
        )),
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
    let map = query.take("map")?;
    state.maps.get_or_only(map.as_deref())?;
    let name = query.take("name")?;
    let detailed = query.take_bool("detail")?;
    let arrival = state.localisations.arrive()?;
    let upload = Upload::read(request, &state.limits, &arrival).await?;
    let question = Question {
        prior: upload.prior(&query)?,
        name: upload
            .name(name.as_deref())
            .unwrap_or_else(|| NO_NAME.to_owned()),
        photo: upload.photo,
        detailed,
        kind,
    };
    let place = arrival.enter(&state.limits)?;
    let shared = state.clone();
    let work = move || {
        let map = shared.maps.get_or_only(map.as_deref())?;
        question.answer(&shared, map)
    };
    let text = place.run(work).await??;
    let content_type = HeaderValue::from_static(kind.media_type());
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
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
        let text = if is_json {
            let detail = self
                .detailed
                .then(|| Detail::of(map, &photo, &self.prior, &outcome));
            serde_json::to_string(&DetailedAnswer { answer, detail })
                .map(|line| line + "\n")
                .map_err(|error| error.to_string())
        } else {
            text_of(self.kind.format().as_mut(), [&answer]).map_err(|error| error.to_string())
        };
        text.map_err(|error| {
            tracing::error!(error, "an answer cannot be written");
            Problem::internal()
        })
    }
}

/// Why a photo cannot be localised, as clients see it.
pub(crate) fn problem_of_locate(error: &LocateError) -> Problem {
    match error {
        LocateError::Photo(error) => problem_of_photo(error),
        LocateError::InvalidValue { .. } => Problem::bad_value(error),
        _ => {
            tracing::error!(%error, "a localisation failed");
            Problem::internal()
        }
    }
}
