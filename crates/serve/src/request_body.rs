//! Reads the body of a request, within limits of size and time.

use std::error::Error;

use axum::BoxError;
use axum::body::{Body, Bytes, HttpBody as _};
use futures_util::StreamExt as _;
use serde::de::DeserializeOwned;
use tokio::time::timeout;

use crate::admission::Arrival;
use crate::limits::Limits;
use crate::problem::Problem;

/// Reads a whole body of `max_bytes` at most, which counts for `arrival` if that is given.
///
/// # Errors
/// Status 408 if it arrives too slowly, 413 if it is too large, 400 if it breaks off, 503 if all bodies together are too large.
pub(crate) async fn read_body(
    body: Body,
    max_bytes: usize,
    limits: &Limits,
    arrival: Option<&Arrival>,
) -> Result<Vec<u8>, Problem> {
    if body.size_hint().lower() > max_bytes as u64 {
        return Err(longer_than(max_bytes));
    }
    let body = match arrival {
        Some(arrival) => counted(body, arrival),
        None => body,
    };
    in_time(limits, read_chunks(body, max_bytes, limits)).await
}

/// What `reading` gives, if the body arrives within `limits.body_time`.
pub(crate) async fn in_time<T>(
    limits: &Limits,
    reading: impl Future<Output = Result<T, Problem>>,
) -> Result<T, Problem> {
    match timeout(limits.body_time, reading).await {
        Ok(result) => result,
        Err(_) => Err(Problem::too_slow(format!(
            "the body did not arrive within {} s",
            limits.body_time.as_secs_f64()
        ))),
    }
}

/// As [`read_body`], for a caller that limits the whole time and counts the bytes.
pub(crate) async fn read_chunks(
    body: Body,
    max_bytes: usize,
    limits: &Limits,
) -> Result<Vec<u8>, Problem> {
    let mut stream = body.into_data_stream();
    let mut bytes = Vec::new();
    loop {
        let next = timeout(limits.body_pause, stream.next()).await;
        match next.map_err(|_| paused(limits))? {
            Some(Ok(chunk)) => append(&mut bytes, &chunk, max_bytes)?,
            Some(Err(error)) => {
                return Err(refusal_of(&error).unwrap_or_else(|| {
                    Problem::bad_request(format!("the body breaks off: {error}"))
                }));
            }
            None => return Ok(bytes),
        }
    }
}

/// The same body, of which every byte that comes counts for `arrival`. It ends with a [`Problem`] of status 503 if all bodies together
/// are too large.
pub(crate) fn counted(body: Body, arrival: &Arrival) -> Body {
    let arrival = arrival.clone();
    Body::from_stream(body.into_data_stream().map(move |chunk| {
        let chunk = chunk.map_err(BoxError::from)?;
        arrival.take(chunk.len())?;
        Ok::<_, BoxError>(chunk)
    }))
}

/// The problem with which a body of [`counted`] ended, where `error` comes from that.
pub(crate) fn refusal_of(error: &dyn Error) -> Option<Problem> {
    let mut causes = std::iter::successors(error.source(), |&cause| cause.source());
    causes.find_map(|cause| cause.downcast_ref::<Problem>().cloned())
}

/// Adds a chunk to what has arrived.
///
/// # Errors
/// Status 413 if it is more than `max_bytes` then.
pub(crate) fn append(bytes: &mut Vec<u8>, chunk: &Bytes, max_bytes: usize) -> Result<(), Problem> {
    if bytes.len() + chunk.len() > max_bytes {
        return Err(longer_than(max_bytes));
    }
    bytes.extend_from_slice(chunk);
    Ok(())
}

fn longer_than(max_bytes: usize) -> Problem {
    Problem::too_large(format!(
        "the content is longer than the limit of {max_bytes} bytes"
    ))
}

/// Status 408: no byte came for `limits.body_pause`.
pub(crate) fn paused(limits: &Limits) -> Problem {
    Problem::too_slow(format!(
        "no byte of the body arrived for {} s",
        limits.body_pause.as_secs_f64()
    ))
}

/// The value of the text of a JSON object, none of `null`. The error names the field that it is about.
pub(crate) fn of_json<T: DeserializeOwned>(json: &[u8]) -> Result<Option<T>, String> {
    // Serde also takes an array as the fields of a structure by their order.
    if !matches!(json.trim_ascii_start().first(), Some(b'{' | b'n')) {
        return Err("expected a JSON object".to_owned());
    }
    let mut reader = serde_json::Deserializer::from_slice(json);
    let value = serde_path_to_error::deserialize(&mut reader).map_err(|error| error.to_string())?;
    reader.end().map_err(|error| error.to_string())?;
    Ok(value)
}
