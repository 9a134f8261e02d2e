//! Which format an answer has: content negotiation (RFC 9110, 12.5.1).

use axum::http::{HeaderMap, header};
use grimnet_answer::{AnswerFormat, Csv, Geojson, Gpx, Jsonl, Kml};

use crate::problem::{Problem, ProblemKind};
use crate::weighted_list::weighted_list;

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

    /// The type of those in `offered` that the client prefers; the first one if it says nothing. Of types with the same weight it is
    /// the one that the client names first.
    ///
    /// # Errors
    /// Status 406 if none is accepted.
    pub(crate) fn accepted(headers: &HeaderMap, offered: &[Self]) -> Result<Self, Problem> {
        let ranges = weighted_list(headers, header::ACCEPT);
        if ranges.is_empty() {
            return offered.first().copied().ok_or_else(Problem::internal);
        }
        let mut best: Option<(f32, usize, Self)> = None;
        for &kind in offered {
            // What the most specific range says of it.
            let named = ranges.iter().enumerate().rev();
            let named = named
                .filter_map(|(at, (range, weight))| Some((kind.specificity(range)?, at, *weight)));
            let Some((_, at, weight)) = named.max_by_key(|(specificity, ..)| *specificity) else {
                continue;
            };
            let is_better = best.is_none_or(|(so_far, first, _)| {
                weight > so_far || (weight == so_far && at < first)
            });
            if weight > 0.0 && is_better {
                best = Some((weight, at, kind));
            }
        }
        best.map(|(.., kind)| kind).ok_or_else(|| {
            let ranges: Vec<_> = ranges.into_iter().map(|(range, _)| range).collect();
            let types: Vec<_> = offered.iter().map(|kind| kind.media_type()).collect();
            Problem::new(
                ProblemKind::NotAcceptable,
                format!(
                    "the Accept header is {:?}; expected one of {}",
                    ranges.join(", "),
                    types.join(", ")
                ),
            )
        })
    }

    /// How exactly a media range such as `application/*` names the type; `None` if it is another one's.
    fn specificity(self, range: &str) -> Option<u8> {
        let is_any_of = |kind: &str| {
            let of_type = kind.strip_suffix('*').filter(|any| any.ends_with('/'));
            of_type.is_some_and(|of_type| self.media_type().starts_with(of_type))
        };
        match range {
            "*/*" => Some(0),
            "application/jsonl" if self == Self::JsonLines => Some(2),
            exact if exact == self.media_type() => Some(2),
            any if is_any_of(any) => Some(1),
            _ => None,
        }
    }
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
            ("application/json;q=0, */*", Some(AnswerType::JsonLines)),
            (
                "*/*;q=0.5, application/json;q=0.1, application/gpx+xml;Q=0.2",
                Some(AnswerType::JsonLines),
            ),
            ("*/*, application/geo+json;q=0.9", Some(AnswerType::Json)),
            (
                "application/geo+json, application/json",
                Some(AnswerType::Geojson),
            ),
            ("application/*;q=0, */*", None),
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
