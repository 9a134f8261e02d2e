//! Photos of clients, decoded within limits.

use grimnet_locate::NeededPixels;
use grimnet_photo::{Photo, PhotoError};

use crate::limits::Limits;
use crate::problem::Problem;

/// Decodes a photo at the size that localisation needs.
///
/// # Errors
/// Status 413 if it is above `limits.photo`, 415 if it is no picture, 422 if it is damaged or otherwise of no use.
pub(crate) fn decode(
    needed: NeededPixels,
    name: &str,
    bytes: &[u8],
    limits: &Limits,
) -> Result<Photo, Problem> {
    let photo = needed
        .decode(name, bytes, &limits.photo)
        .map_err(|error| problem_of_photo(&error))?;
    match photo.damage {
        None => Ok(photo),
        Some(damage) => Err(problem_of_photo(&PhotoError::Corrupt {
            path: name.into(),
            detail: damage.to_string(),
        })),
    }
}

/// A photo that cannot be used, as clients see it.
pub(crate) fn problem_of_photo(error: &PhotoError) -> Problem {
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
