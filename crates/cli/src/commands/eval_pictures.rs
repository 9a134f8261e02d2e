//! The pictures of an evaluation: the map with truth and answers, and the worst frames' matches.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_eval::map_picture::{self, Mark};
use grimnet_eval::report::{Picture, Run};
use grimnet_eval::truth::TruthFrame;
use grimnet_geo::{LonLat, Raster};
use grimnet_locate::{Localizer, Prior};
use grimnet_output::{OutputFolder, file_name_from};

use super::locate::locate_one;
use crate::answer::Answer;
use crate::drawings::jpeg_of;

/// Frames whose matches are drawn.
const WORST: usize = 5;

/// What is drawn.
pub struct Drawn<'a> {
    /// Answers again, with matches kept.
    pub localizer: &'a Localizer,
    /// The map.
    pub map: &'a dyn Raster,
    /// The photos and where they were.
    pub truth: &'a [(TruthFrame, PathBuf)],
    /// What was answered in the run that is drawn.
    pub answers: &'a [Answer],
    /// That run.
    pub run: &'a Run,
    /// Where the drawings of matches are written.
    pub folder: &'a OutputFolder,
    /// What the localiser was told of a photo in that run.
    pub prior_of: &'a dyn Fn(&TruthFrame, &Path) -> Prior,
}

/// Draws the map, then the worst frames: misses first, then by error.
///
/// # Errors
/// The map cannot be read, or a picture not be written.
pub fn draw(drawn: &Drawn<'_>) -> Result<Vec<Picture>> {
    let mut pictures = vec![whole_map(drawn)?];
    let mut worst: Vec<usize> = (0..drawn.truth.len()).collect();
    let mut names = HashSet::new();
    let badness = |i: &usize| drawn.run.frames[*i].error_m.unwrap_or(f64::INFINITY);
    worst.sort_by(|a, b| badness(b).total_cmp(&badness(a)));
    for &i in worst.iter().take(WORST) {
        let (frame, path) = &drawn.truth[i];
        let prior = (drawn.prior_of)(frame, path);
        let Ok((photo, outcome)) = locate_one(drawn.localizer, path, &prior) else {
            continue;
        };
        let Some(jpeg) = jpeg_of(&photo, &outcome, Some(drawn.map))? else {
            continue;
        };
        drawn
            .folder
            .write_bytes(&picture_name(&frame.photo, &mut names), &jpeg)?;
        let scored = &drawn.run.frames[i];
        let caption = match (scored.error_m, &scored.reason) {
            (Some(error_m), _) => format!(
                "{}: {error_m:.1} m off, {} matches agree",
                frame.photo,
                scored.inliers.unwrap_or(0)
            ),
            (None, reason) => format!(
                "{}: no fix, {}",
                frame.photo,
                reason.as_deref().unwrap_or("without a reason")
            ),
        };
        pictures.push(Picture { caption, jpeg });
    }
    drawn.folder.prune(|_| true)?;
    Ok(pictures)
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

fn whole_map(drawn: &Drawn<'_>) -> Result<Picture> {
    let marks: Vec<Mark> = drawn
        .truth
        .iter()
        .zip(drawn.answers)
        .filter_map(|((frame, _), answer)| {
            let (lat_deg, lon_deg) = frame.centre_lat_lon_deg.or(frame.gps_lat_lon_deg)?;
            Some(Mark {
                truth: LonLat { lon_deg, lat_deg },
                answer: answer
                    .lat_deg
                    .zip(answer.lon_deg)
                    .map(|(lat_deg, lon_deg)| LonLat { lon_deg, lat_deg }),
            })
        })
        .collect();
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 82);
    map_picture::draw(drawn.map, &marks)?.write_with_encoder(encoder)?;
    Ok(Picture {
        caption: format!(
            "{}: truth in green, answers in red, photos without a fix in yellow",
            drawn.run.name
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
