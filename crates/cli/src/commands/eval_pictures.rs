//! The pictures of an evaluation: the map with true positions and fixes, and the matches of the worst photos.

use std::collections::HashSet;
use std::path::Path;

use anyhow::Result;
use grimnet_eval::evaluation::Trial;
use grimnet_eval::report::Picture;
use grimnet_eval::report::map_picture::{self, Mark};
use grimnet_eval::scene::{Scene, Shot};
use grimnet_geo::Raster;
use grimnet_output::{OutputFolder, file_name_from};

use crate::drawings::jpeg_of;

/// Photos whose matches are drawn.
const WORST: usize = 5;

/// JPEG quality of the map.
const MAP_JPEG_QUALITY: u8 = 82;

/// What the colours of a picture of matches mean.
pub const COLOURS: &str =
    "matches that agree in green, others in red, outline of the photo in yellow";

/// Draws the map of one run, then the worst photos: misses first, then by error.
///
/// # Errors
/// The map cannot be read, or a picture not be written.
pub fn draw(
    scene: &Scene,
    trials: &[Trial],
    run: &str,
    folder: &OutputFolder,
) -> Result<Vec<Picture>> {
    let mut pictures = vec![whole_map(scene, trials, run)?];
    let mut worst: Vec<usize> = (0..trials.len()).collect();
    let mut names = HashSet::new();
    let badness = |i: &usize| trials[*i].frame.error_m.unwrap_or(f64::INFINITY);
    worst.sort_by(|a, b| badness(b).total_cmp(&badness(a)));
    // Photos that cannot be read or were not matched have nothing to draw, and must not take the place of others.
    let drawn = worst.into_iter().filter_map(|i| {
        let jpeg = matches_jpeg(&scene.shots[i], &trials[i], scene.map.as_ref());
        Some((i, jpeg.transpose()?))
    });
    for (i, jpeg) in drawn.take(WORST) {
        let (shot, frame, jpeg) = (&scene.shots[i], &trials[i].frame, jpeg?);
        folder.write_bytes(&picture_name(&shot.name, &mut names), &jpeg)?;
        let caption = match (frame.error_m, &frame.reason) {
            (Some(error_m), _) => format!(
                "{}: error {error_m:.1} m, {} inliers",
                shot.name,
                frame.inliers.unwrap_or(0)
            ),
            (None, reason) => format!(
                "{}: no fix, {}",
                shot.name,
                reason.as_deref().unwrap_or("no reason given")
            ),
        };
        pictures.push(Picture {
            caption: format!("{caption} ({COLOURS})"),
            jpeg,
        });
    }
    folder.prune(|_| true)?;
    Ok(pictures)
}

/// The names that pictures of these photos may get.
pub fn names(shots: &[Shot]) -> Vec<String> {
    let mut taken = HashSet::new();
    let name = |shot: &Shot| picture_name(&shot.name, &mut taken);
    shots.iter().map(name).collect()
}

/// A JPEG of the matches of one photo; `None` if nothing was matched or the photo cannot be read.
///
/// # Errors
/// The map cannot be read.
pub fn matches_jpeg(shot: &Shot, trial: &Trial, map: &dyn Raster) -> Result<Option<Vec<u8>>> {
    let outcome = trial.found.as_ref().ok().and_then(|f| f.outcome.as_ref());
    match (outcome, shot.photo.open()) {
        (Some(outcome), Ok(photo)) => jpeg_of(&photo, outcome, Some(map)),
        _ => Ok(None),
    }
}

/// File name of a photo's drawing: the truth file may name the photo by a path, also an absolute one.
fn picture_name(photo: &str, taken: &mut HashSet<String>) -> String {
    let stem = file_name_from(photo);
    let stem = Path::new(&stem)
        .file_stem()
        .map_or_else(|| stem.clone(), |stem| stem.to_string_lossy().into_owned());
    let mut name = format!("{stem}.jpg");
    let mut number = 2;
    while !taken.insert(name.clone()) {
        name = format!("{stem}-{number}.jpg");
        number += 1;
    }
    name
}

fn whole_map(scene: &Scene, trials: &[Trial], run: &str) -> Result<Picture> {
    let marks: Vec<Mark> = scene
        .shots
        .iter()
        .zip(trials)
        .map(|(shot, trial)| Mark {
            truth: shot.truth.position,
            answer: trial
                .found
                .as_ref()
                .ok()
                .and_then(|found| Some(found.fix?.position)),
        })
        .collect();
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, MAP_JPEG_QUALITY);
    map_picture::draw(scene.map.as_ref(), &marks)?.write_with_encoder(encoder)?;
    Ok(Picture {
        caption: format!(
            "{run}: true positions in green, fixes in red, photos without a fix in yellow"
        ),
        jpeg,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawings_stay_in_their_folder_and_keep_apart() {
        let mut taken = HashSet::new();
        let mut name = |photo: &str| picture_name(photo, &mut taken);
        assert_eq!(name("/etc/a.jpg"), "etc_a.jpg");
        assert_eq!(name("sub/a.jpg"), "sub_a.jpg");
        assert_eq!(name("sub_a.png"), "sub_a-2.jpg");
        assert_eq!(name("../../a.tif"), "a.jpg");
    }
}
