//! The pictures of an evaluation: the map with truth and answers, and the worst frames' matches.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use grimnet_eval::map_picture::{self, Mark};
use grimnet_eval::report::{Picture, Run};
use grimnet_eval::truth::TruthFrame;
use grimnet_geo::{LonLat, Raster};
use grimnet_locate::{Localizer, Prior};

use super::locate::{draw as draw_matches, locate_one};
use crate::answer::Answer;

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
    /// Where the match pictures are kept.
    pub folder: &'a Path,
    /// What the localiser was told of a photo in that run.
    pub prior_of: &'a dyn Fn(&TruthFrame, &Path) -> Prior,
}

/// Draws the map, then the worst frames: misses first, then by error.
///
/// # Errors
/// The map cannot be read, or a picture not be written.
pub fn draw(drawn: &Drawn<'_>) -> Result<Vec<Picture>> {
    fs_err::create_dir_all(drawn.folder)?;
    let mut pictures = vec![whole_map(drawn)?];
    let mut worst: Vec<usize> = (0..drawn.truth.len()).collect();
    let badness = |i: &usize| drawn.run.frames[*i].error_m.unwrap_or(f64::INFINITY);
    worst.sort_by(|a, b| badness(b).total_cmp(&badness(a)));
    for &i in worst.iter().take(WORST) {
        let (frame, path) = &drawn.truth[i];
        let prior = (drawn.prior_of)(frame, path);
        let Ok((photo, outcome)) = locate_one(drawn.localizer, path, &prior) else {
            continue;
        };
        let file = drawn.folder.join(&frame.photo).with_extension("jpg");
        if !draw_matches(&photo, &outcome, Some(drawn.map), &file)? {
            continue;
        }
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
        pictures.push(Picture {
            caption,
            jpeg: fs_err::read(&file).context("cannot read the picture again")?,
        });
    }
    Ok(pictures)
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
