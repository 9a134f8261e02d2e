//! Localising single photos, as several commands do.

use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_locate::{Localizer, Outcome, Prior};
use grimnet_photo::{Photo, PhotoLimits};

use crate::inputs;

/// Opens a photo within the limits, at the size that a query needs, and localises it.
///
/// # Errors
/// The photo cannot be read.
pub fn locate_one(
    localizer: &Localizer,
    path: &Path,
    prior: &Prior,
    limits: &PhotoLimits,
) -> Result<(Photo, Outcome)> {
    inputs::check_regular(path)?;
    let photo = localizer.needed_pixels(prior).open(path, limits)?;
    let outcome = localizer.locate(&photo, prior)?;
    Ok((photo, outcome))
}

/// A localiser whose photo statistics come from all the given photos; those that cannot be read within the limits are left out.
///
/// # Errors
/// None of the photos can be used.
pub fn adapt_to_flight(
    localizer: Localizer,
    paths: &[PathBuf],
    prior: &Prior,
    limits: &PhotoLimits,
) -> Result<Localizer> {
    let needed = localizer.needed_pixels(prior);
    let photos: Vec<Photo> = paths
        .iter()
        .filter(|path| inputs::check_regular(path).is_ok())
        .filter_map(|path| needed.open(path, limits).ok())
        .collect();
    Ok(localizer.adapted_to_flight(photos.iter().map(|photo| (photo, prior)))?)
}
