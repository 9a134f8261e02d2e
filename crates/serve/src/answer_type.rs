//! Which format an answer has: content negotiation (RFC 9110, 12.5.1).

use axum::http::{HeaderMap, HeaderValue, header};
use grimnet_answer::{AnswerFormat, Csv, Geojson, Gpx, Jsonl, Kml};

use crate::problem::{Problem, ProblemKind};

/// A format of answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AnswerType {
    Json,
    JsonLines,
    Geojson,
    Kml,
    Gpx,
    Csv,
}

impl AnswerType {
    /// The media type.
    pub(crate) fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::JsonLines => "application/x-ndjson",
            Self::Geojson => "application/geo+json",
            Self::Kml => "application/vnd.google-earth.kml+xml",
            Self::Gpx => "application/gpx+xml",
            Self::Csv => "text/csv",
        }
    }

    /// The writer of the format; one answer as JSON is a JSON line.
    pub(crate) fn format(self) -> Box<dyn AnswerFormat> {
        match self {
            Self::Json | Self::JsonLines => Box::new(Jsonl),
            Self::Geojson => Box::<Geojson>::default(),
            Self::Kml => Box::new(Kml),
            Self::Gpx => Box::new(Gpx),
            Self::Csv => Box::new(Csv),
        }
    }

    /// The type of those in `offered` that the client prefers; the first one if it says nothing.
    ///
    /// # Errors
    /// Status 406 if none is accepted.
    pub(crate) fn accepted(headers: &HeaderMap, offered: &[Self]) -> Result<Self, Problem> {
        let ranges: Vec<&str> = headers
            .get_all(header::ACCEPT)
            .iter()
            .filter_map(|value: &HeaderValue| value.to_str().ok())
            .flat_map(|value| value.split(','))
            .filter(|range| !range.trim().is_empty())
            .collect();
        if ranges.is_empty() {
            return offered.first().copied().ok_or_else(Problem::internal);
        }
        let mut best: Option<(f32, Self)> = None;
        for range in &ranges {
            let Some((kind, quality)) = accepted_range(range, offered) else {
                continue;
            };
            if best.is_none_or(|(so_far, _)| quality > so_far) {
                best = Some((quality, kind));
            }
        }
        best.map(|(_, kind)| kind).ok_or_else(|| {
            Problem::new(
                ProblemKind::NotAcceptable,
                format!(
                    "the Accept header is {:?}; expected one of {}",
                    ranges.join(","),
                    offered
                        .iter()
                        .map(|kind| kind.media_type())
                        .collect::<Vec<_>>()
                        .join(", ")
                ),
            )
        })
    }
}

/// The first type in `offered` that a media range such as `application/geo+json;q=0.5` asks for, and its weight; `None` if it is
/// another one or the weight is 0.
fn accepted_range(range: &str, offered: &[AnswerType]) -> Option<(AnswerType, f32)> {
    let mut parts = range.split(';').map(str::trim);
    let name = parts.next()?.to_ascii_lowercase();
    let quality = parts
        .find_map(|part| part.strip_prefix("q="))
        .map_or(1.0, |q| q.parse::<f32>().unwrap_or(0.0));
    let asked_for = |kind: &AnswerType| match name.as_str() {
        "*/*" => true,
        "application/jsonl" => *kind == AnswerType::JsonLines,
        exact_or_any => {
            let any_of = exact_or_any
                .strip_suffix('*')
                .filter(|any| any.ends_with('/'));
            any_of.map_or(kind.media_type() == exact_or_any, |any| {
                kind.media_type().starts_with(any)
            })
        }
    };
    let kind = offered.iter().copied().find(asked_for)?;
    (quality > 0.0).then_some((kind, quality))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFERED: [AnswerType; 5] = [
        AnswerType::Json,
        AnswerType::JsonLines,
        AnswerType::Geojson,
        AnswerType::Kml,
        AnswerType::Gpx,
    ];

    fn accepted(accept: &str) -> Option<AnswerType> {
        let mut headers = HeaderMap::new();
        headers.insert(header::ACCEPT, accept.parse().unwrap());
        AnswerType::accepted(&headers, &OFFERED).ok()
    }

    #[test]
    fn the_preferred_type_is_chosen() {
        assert_eq!(
            AnswerType::accepted(&HeaderMap::new(), &OFFERED).unwrap(),
            AnswerType::Json
        );
        for (accept, expected) in [
            ("*/*", Some(AnswerType::Json)),
            ("application/geo+json", Some(AnswerType::Geojson)),
            (
                "text/html, application/geo+json;q=0.9, */*;q=0.1",
                Some(AnswerType::Geojson),
            ),
            (
                "application/json;q=0.2, Application/GPX+XML;q=0.3",
                Some(AnswerType::Gpx),
            ),
            (
                "application/vnd.google-earth.kml+xml",
                Some(AnswerType::Kml),
            ),
            (
                "application/geo+json;q=0, */*;q=0.5",
                Some(AnswerType::Json),
            ),
            ("application/x-ndjson", Some(AnswerType::JsonLines)),
            ("application/jsonl", Some(AnswerType::JsonLines)),
            ("application/*", Some(AnswerType::Json)),
            ("text/html", None),
            ("text/*", None),
            ("text/csv", None),
            ("application/json;q=0", None),
            ("application/json;q=x", None),
        ] {
            assert_eq!(accepted(accept), expected, "{accept}");
        }
    }
}
