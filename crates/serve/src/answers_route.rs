//! `POST /v1/answers`: answers in another format.

use axum::extract::Request;
use axum::http::{HeaderMap, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use grimnet_answer::{Answer, text_of};
use serde::de::{Deserialize, Deserializer, IgnoredAny, SeqAccess, Visitor};

use crate::answer_type::AnswerType;
use crate::problem::Problem;
use crate::request_body::read_body;
use crate::state::Shared;

/// Largest list of answers, bytes: thousands of them.
pub(crate) const MAX_ANSWERS_BYTES: usize = 8 << 20;

/// Most answers in a list. Each may be a few bytes of the body, and takes hundreds in memory.
const MAX_ANSWERS: usize = 20_000;

/// What a list of answers can be; JSON lines unless the client says otherwise.
const OFFERED: [AnswerType; 6] = [
    AnswerType::JsonLines,
    AnswerType::Json,
    AnswerType::Geojson,
    AnswerType::Kml,
    AnswerType::Gpx,
    AnswerType::Csv,
];

/// Writes answers in another format
///
/// A list of answers of `/v1/locate`, 20,000 at most, for a file of all of them. `application/json` is a list again, `application/x-ndjson` a line
/// for each answer.
#[utoipa::path(
    post, path = "/v1/answers", tag = "locate",
    request_body = Vec<Answer>,
    responses((status = 200, description = "The answers", content(
        (String = "application/x-ndjson"),
        (Vec<Answer> = "application/json"),
        (crate::openapi::GeoJson = "application/geo+json"),
        (String = "application/vnd.google-earth.kml+xml"),
        (String = "application/gpx+xml"),
        (String = "text/csv"),
    )))
)]
pub(crate) async fn answers(
    axum::extract::State(state): Shared,
    headers: HeaderMap,
    request: Request,
) -> Result<Response, Problem> {
    let kind = AnswerType::accepted(&headers, &OFFERED)?;
    let arrival = state.conversions.arrive()?;
    let body = request.into_body();
    let body = read_body(body, MAX_ANSWERS_BYTES, &state.limits, Some(&arrival)).await?;
    let place = arrival.enter(&state.limits)?;
    let text = place.run(move || converted(&body, kind)).await??;
    let text = state.conversions.hold(text)?;
    let content_type = HeaderValue::from_static(kind.media_type());
    Ok(([(header::CONTENT_TYPE, content_type)], text).into_response())
}

/// A list of answers as JSON in another format.
fn converted(json: &[u8], kind: AnswerType) -> Result<String, Problem> {
    let Answers { answers, are_all } = serde_json::from_slice(json).map_err(|error| {
        Problem::bad_request(format!("the body is no JSON array of answers: {error}"))
    })?;
    if !are_all {
        return Err(Problem::too_large(format!(
            "the list is longer than the limit of {MAX_ANSWERS} answers; send it in parts"
        )));
    }
    if let Some(at) = answers.iter().position(|answer| !is_on_earth(answer)) {
        return Err(Problem::bad_value(format!(
            "answer {} of the list has a position that is not on Earth; expected latitudes from -90 to 90 and longitudes from -360 to \
             360 degrees",
            at + 1
        )));
    }
    let text = match kind {
        AnswerType::Json => serde_json::to_string(&answers).map_err(|error| error.to_string()),
        kind => text_of(kind.format().as_mut(), &answers).map_err(|error| error.to_string()),
    };
    text.map_err(|error| {
        tracing::error!(error, "answers cannot be written");
        Problem::internal()
    })
}

/// Whether all positions of an answer are on Earth. Other numbers could be of no use, and 1e308 is five bytes of a list and hundreds of
/// the text that is made of it.
fn is_on_earth(answer: &Answer) -> bool {
    let position = answer.lon_deg.zip(answer.lat_deg);
    let outline = answer.outline_lon_lat_deg.iter().flatten();
    let mut positions = outline
        .copied()
        .chain(position.map(|(lon, lat)| [lon, lat]));
    positions.all(|[lon, lat]| lon.abs() <= 360.0 && lat.abs() <= 90.0)
}

/// The first [`MAX_ANSWERS`] of a list.
struct Answers {
    answers: Vec<Answer>,
    are_all: bool,
}

impl<'de> Deserialize<'de> for Answers {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct List;

        impl<'de> Visitor<'de> for List {
            type Value = Answers;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a list of answers")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Answers, A::Error> {
                let mut answers = Vec::new();
                while answers.len() < MAX_ANSWERS {
                    match list.next_element()? {
                        Some(answer) => answers.push(answer),
                        None => break,
                    }
                }
                let mut are_all = true;
                while list.next_element::<IgnoredAny>()?.is_some() {
                    are_all = false;
                }
                Ok(Answers { answers, are_all })
            }
        }

        deserializer.deserialize_seq(List)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_very_many_answers_is_refused() {
        let list = |count: usize| format!("[{}]", vec!["{}"; count].join(","));
        let text = converted(list(MAX_ANSWERS).as_bytes(), AnswerType::JsonLines).unwrap();
        assert_eq!(text.lines().count(), MAX_ANSWERS);
        let longer = list(MAX_ANSWERS + 1);
        let expected = Problem::too_large(
            "the list is longer than the limit of 20000 answers; send it in parts",
        );
        assert_eq!(converted(longer.as_bytes(), AnswerType::Csv), Err(expected));
    }

    #[test]
    fn positions_that_are_not_on_earth_are_refused() {
        for answer in [
            r#"{"state": "fix", "lat_deg": 1e308, "lon_deg": 0}"#,
            r#"{"state": "fix", "lat_deg": 120, "lon_deg": 24}"#,
            r#"{"outline_lon_lat_deg": [[0, 0], [0, 1e308], [1, 0]]}"#,
        ] {
            let list = format!("[{{}}, {answer}]");
            let refused = converted(list.as_bytes(), AnswerType::Kml).unwrap_err();
            assert!(refused.to_string().starts_with("answer 2 "), "{refused}");
        }
    }
}
