//! The flight that ends `grim demo`: over town, fields and water, followed frame by frame.

use anyhow::Result;
use grimnet_answer::printable;
use grimnet_flight::{Flight, FlightOptions, Known};
use grimnet_geo::Raster;
use grimnet_locate::{Localizer, Options, Prior};
use grimnet_output::OutputFolder;

use super::track_report::{Scored, figures_text, page};
use crate::procedural_flight::make_crossing;
use crate::progress;
use crate::tracking::formats::TrackFormat;
use crate::tracking::frames::{FrameOptions, Frames as _};
use crate::tracking::photo_list::PhotoList;
use crate::tracking::session::Session;
use crate::tracking::truth::Truth;

/// Draws the flight, follows it, and writes `track.jsonl`, `track.gpx` and `track.html`. Gives a line for the reader.
///
/// # Errors
/// The folder cannot be written.
pub fn follow_crossing(
    folder: &OutputFolder,
    seed: u64,
    localizer: Localizer,
    map: &dyn Raster,
) -> Result<String> {
    let shares = make_crossing(folder, seed)?;
    let photos = crate::photos::expand(&[folder.path().join("flight")])?;
    let options = FrameOptions {
        needed: Some(localizer.needed_pixels(&Prior::none())),
        ..FrameOptions::default()
    };
    let mut frames = PhotoList::new(photos, &options)?;
    let truth = Truth::read(&folder.path().join("flight_truth.csv"))?;
    let options = Options {
        keep_matches: false,
        ..localizer.options().clone()
    };
    let flight = Flight::new(localizer.with_options(options), FlightOptions::default())?;
    let mut session = Session::new(flight, Known::default(), None, false);
    let (mut scored, mut lines) = (Vec::new(), Vec::new());
    let bar = progress::bar(frames.count().unwrap_or(0) as u64, "following", "frames");
    let never = std::sync::atomic::AtomicBool::new(false);
    while let Some(frame) = frames.next(&never)? {
        let tracked = session.frame(frame, frames.epoch())?;
        scored.push(Scored::of(&tracked, Some(&truth)));
        lines.push(tracked.line);
        bar.inc(1);
    }
    bar.finish_and_clear();
    for (format, file) in [
        (TrackFormat::Jsonl, "track.jsonl"),
        (TrackFormat::Gpx, "track.gpx"),
    ] {
        folder.write_bytes(file, format.text_of(&lines)?.as_bytes())?;
    }
    let [town, countryside, water] = shares.map(|share| 100.0 * share);
    let description = vec![
        format!(
            "A flight of half a kilometre over {town:.0} % town, {countryside:.0} % fields and {water:.0} % water, a frame a second; \
             the gimbal tells its angles with an error of half a degree."
        ),
        "Everything here was made by this program: there is no such town, and real maps are harder.".into(),
    ];
    let page = page(
        "A flight over a procedural town, followed",
        description,
        &scored,
    );
    folder.write_bytes("track.html", page.to_html(Some(map))?.as_bytes())?;
    let figures = figures_text(&scored).unwrap_or_default();
    Ok(format!(
        "The flight over {town:.0} % town, {countryside:.0} % fields and {water:.0} % water: {figures}. Its track beside the truth \
         is in {}",
        printable(&folder.path().join("track.html").display().to_string())
    ))
}
