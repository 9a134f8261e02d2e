//! A photo and its prior from the body of a request.

use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{FromRequest as _, Request};
use axum::http::header;
use grimnet_locate::Prior;
use tokio::time::timeout;

use crate::admission::Arrival;
use crate::limits::Limits;
use crate::prior_fields::PriorFields;
use crate::problem::Problem;
use crate::query::Query;
use crate::request_body::{append, counted, in_time, paused, read_chunks, refusal_of};

/// Largest prior, bytes.
const MAX_PRIOR_BYTES: usize = 64 << 10;

/// Longest name of a photo that is repeated in the answer, characters.
const MAX_NAME_CHARACTERS: usize = 200;

/// Types of a body that is a photo itself.
const PHOTO_TYPES: [&str; 5] = [
    "image/jpeg",
    "image/png",
    "image/tiff",
    "image/webp",
    "application/octet-stream",
];

/// What a client sent.
#[derive(Debug, Default)]
pub(crate) struct Upload {
    /// The bytes of the photo file.
    pub photo: Vec<u8>,
    /// The name that the client gave the file. It is repeated in the answer and used for nothing else.
    name: Option<String>,
    /// The part `prior` of a multipart body.
    prior: Option<PriorFields>,
}

impl Upload {
    /// Reads the body of a request: `multipart/form-data` with the parts `photo` and `prior`, or the bytes of a photo file.
    ///
    /// # Errors
    /// Status 408 if it arrives too slowly, 413 if it is too large, 415 for another content type, 400 if it is malformed, 503 if
    /// all bodies together are too large.
    pub(crate) async fn read(
        request: Request,
        limits: &Limits,
        arrival: &Arrival,
    ) -> Result<Self, Problem> {
        in_time(limits, Self::read_all(request, limits, arrival)).await
    }

    /// The prior from the body or from the query, not from both.
    ///
    /// # Errors
    /// Status 400 if there are two, or it is not understood; 422 if a value cannot be used.
    pub(crate) fn prior(&self, query: &Query) -> Result<Prior, Problem> {
        match &self.prior {
            Some(_) if !query.is_empty() => {
                // A parameter that is none of the prior is named.
                PriorFields::from_pairs(query.pairs())?;
                Err(Problem::bad_request(
                    "the prior is given as a part of the body and in the query; expected one of them",
                ))
            }
            Some(fields) => fields.prior(),
            None => PriorFields::from_pairs(query.pairs())?.prior(),
        }
    }

    /// The name of the photo in the answer: that of the query, else that of the file.
    pub(crate) fn name(&self, in_query: Option<&str>) -> Option<String> {
        in_query.and_then(label).or_else(|| self.name.clone())
    }

    async fn read_all(
        request: Request,
        limits: &Limits,
        arrival: &Arrival,
    ) -> Result<Self, Problem> {
        let declared = request
            .headers()
            .get(header::CONTENT_LENGTH)
            .and_then(|value| value.to_str().ok())
            .and_then(|value| value.parse::<u64>().ok());
        if declared.is_some_and(|bytes| bytes > limits.max_body_bytes as u64) {
            return Err(too_large(limits));
        }
        let content_type = request
            .headers()
            .get(header::CONTENT_TYPE)
            .and_then(|value| value.to_str().ok())
            .unwrap_or_default();
        let essence = content_type.split(';').next().unwrap_or_default().trim();
        let essence = essence.to_ascii_lowercase();
        // Before a form is taken apart: what comes before its first part is held, too.
        let request = request.map(|body| counted(body, arrival));
        let upload = if essence == "multipart/form-data" {
            let multipart = Multipart::from_request(request, &())
                .await
                .map_err(|error| Problem::bad_request(error.body_text()))?;
            Self::read_parts(multipart, limits).await?
        } else if PHOTO_TYPES.contains(&essence.as_str()) {
            let photo = read_chunks(request.into_body(), limits.max_body_bytes, limits).await?;
            Self {
                photo,
                ..Self::default()
            }
        } else {
            return Err(Problem::unsupported(format!(
                "the body is {essence:?}; expected multipart/form-data with the photo as `photo`, or a photo as {}",
                PHOTO_TYPES.join(", ")
            )));
        };
        if upload.photo.is_empty() {
            return Err(Problem::bad_request(
                "there is no photo; expected its bytes as the part `photo` or as the whole body",
            ));
        }
        Ok(upload)
    }

    async fn read_parts(mut parts: Multipart, limits: &Limits) -> Result<Self, Problem> {
        let mut upload = Self::default();
        let mut has_photo = false;
        loop {
            let next = timeout(limits.body_pause, parts.next_field()).await;
            let next = next.map_err(|_| paused(limits))?;
            let Some(part) = next.map_err(|error| malformed(&error, limits))? else {
                return Ok(upload);
            };
            match part.name() {
                Some("photo") if !has_photo => {
                    has_photo = true;
                    upload.name = part.file_name().and_then(label);
                    upload.photo = read_part(part, limits.max_body_bytes, limits).await?;
                }
                Some("prior") if upload.prior.is_none() => {
                    let json = read_part(part, MAX_PRIOR_BYTES, limits).await?;
                    upload.prior = Some(PriorFields::from_json(&json)?);
                }
                Some(name @ ("photo" | "prior")) => {
                    return Err(Problem::bad_request(format!(
                        "there are two parts {name:?}"
                    )));
                }
                name => {
                    return Err(Problem::bad_request(format!(
                        "there is a part {:?}; expected `photo` and `prior`",
                        name.unwrap_or_default()
                    )));
                }
            }
        }
    }
}

/// The last part of a file name, for display.
fn label(name: &str) -> Option<String> {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let label: String = last.chars().take(MAX_NAME_CHARACTERS).collect();
    (!label.is_empty()).then_some(label)
}

async fn read_part(
    mut part: Field<'_>,
    max_bytes: usize,
    limits: &Limits,
) -> Result<Vec<u8>, Problem> {
    let mut bytes = Vec::new();
    loop {
        let next = timeout(limits.body_pause, part.chunk()).await;
        let next = next.map_err(|_| paused(limits))?;
        match next.map_err(|error| malformed(&error, limits))? {
            Some(chunk) => append(&mut bytes, &chunk, max_bytes)?,
            None => return Ok(bytes),
        }
    }
}

fn malformed(error: &MultipartError, limits: &Limits) -> Problem {
    if let Some(refused) = refusal_of(error) {
        return refused;
    }
    if error.status() == axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        return too_large(limits);
    }
    Problem::bad_request(format!(
        "the multipart body is malformed: {}",
        error.body_text()
    ))
}

fn too_large(limits: &Limits) -> Problem {
    Problem::too_large(format!(
        "the body is longer than the limit of {} bytes",
        limits.max_body_bytes
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_no_paths() {
        assert_eq!(label("../../etc/passwd").as_deref(), Some("passwd"));
        assert_eq!(label("C:\\photos\\a.jpg").as_deref(), Some("a.jpg"));
        assert_eq!(label("photos/"), None);
        assert_eq!(
            label(&"ä".repeat(900)).map(|l| l.chars().count()),
            Some(200)
        );
    }
}
