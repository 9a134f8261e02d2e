//! Localising single photos, as several commands do.

use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_answer::printable;
use grimnet_geo::LonLat;
use grimnet_locate::{Localizer, Near, Outcome, Prior};
use grimnet_pack::{Mode, Pack};
use grimnet_photo::{Photo, PhotoLimits};

use crate::inputs;

/// Opens a pack for photos that are localised in `mode`. Warns of one that was built for the paper's procedure alone.
///
/// # Errors
/// The pack cannot be read.
pub fn open_pack(path: &Path, mode: Mode) -> Result<Pack> {
    inputs::check_regular(path)?;
    let pack = Pack::open(path)?;
    if pack.mode() == Mode::Paper && mode != Mode::Paper {
        tracing::warn!(
            "{} was built in paper mode, in which its tiles have another size: fewer photos get a fix; localise them with --mode paper, or \
             build it without",
            printable(&path.display().to_string())
        );
    }
    Ok(pack)
}

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

/// A localiser whose photo statistics come from all the given photos; those that are damaged or cannot be read within the limits are left
/// out. Without any other it stays as it is: the answer of each photo says what is wrong with it.
///
/// # Errors
/// A photo cannot be resampled, or none of those that can be read can be used.
pub fn adapt_to_flight(
    localizer: Localizer,
    paths: &[PathBuf],
    prior: &Prior,
    limits: &PhotoLimits,
) -> Result<Localizer> {
    let needed = localizer.needed_pixels(prior);
    let mut photos = paths
        .iter()
        .filter(|path| inputs::check_regular(path).is_ok())
        .filter_map(|path| needed.open(path, limits).ok())
        .filter(|photo| photo.damage.is_none())
        .peekable();
    if photos.peek().is_none() {
        return Ok(localizer);
    }
    Ok(localizer.adapted_to_flight(photos.map(|photo| (photo, prior)))?)
}

/// Warns if no tile of the pack shows the area that `option` names: degrees that are exchanged, or another pack.
///
/// # Errors
/// The pack has no coordinates.
pub fn warn_if_off_the_map(option: &str, area: &Near, localizer: &Localizer) -> Result<()> {
    if !localizer.has_tiles_near(area)? {
        let LonLat { lon_deg, lat_deg } = area.centre;
        tracing::warn!(
            "{option} {lat_deg},{lon_deg},{} is not on the map of {}: latitude comes first, then longitude",
            area.radius_m,
            printable(&localizer.pack().path().display().to_string())
        );
    }
    Ok(())
}
