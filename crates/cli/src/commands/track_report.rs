//! The page of `grim track --report`, and the figures against the truth.

use std::path::Path;

use anyhow::Result;
use grimnet_eval::report::track_page::{TrackMark, TrackPage};
use grimnet_geo::{LonLat, Raster};
use grimnet_output::{OutputFolder, OutputPolicy};
use grimnet_pack::Pack;
use grimnet_track::Source;

use super::map_place::MapPlace;
use crate::tracking::line::TrackLine;
use crate::tracking::session::Tracked;
use crate::tracking::truth::{Compared, Truth, summary};

/// The page in the folder.
pub const PAGE: &str = "report.html";

/// A frame for the report.
#[derive(Debug, Clone, Copy)]
pub struct Scored {
    mark: TrackMark,
    compared: Option<Compared>,
}

impl Scored {
    /// Of a frame, with its truth if that is known.
    pub fn of(tracked: &Tracked, truth: Option<&Truth>) -> Self {
        let line = &tracked.line;
        let compared = truth
            .and_then(|truth| truth.compare(line.photo(), tracked.time_s, tracked.point.as_ref()));
        Self::new(Some(line), tracked.time_s, compared)
    }

    /// Of a frame in a smoothed track, which may have no line for it, with its truth if that is known.
    pub fn of_smoothed(
        (time_s, frame): &(f64, TrackLine),
        smoothed: &[(f64, TrackLine)],
        truth: Option<&Truth>,
    ) -> Self {
        let line = smoothed
            .iter()
            .find(|(smoothed_s, _)| smoothed_s == time_s)
            .map(|(_, line)| line);
        let compared = truth.and_then(|truth| truth.compare_smoothed(frame.photo(), *time_s, line));
        Self::new(line, *time_s, compared)
    }

    /// Of a frame, where `track` has its position.
    fn new(track: Option<&TrackLine>, time_s: f64, compared: Option<Compared>) -> Self {
        let place = track.and_then(TrackLine::lon_lat_deg);
        Self {
            mark: TrackMark {
                time_s,
                place: place.map(|[lon, lat]| LonLat::new(lon, lat)),
                covariance_en_m2: track
                    .and_then(|line| line.covariance_en_m2)
                    .unwrap_or_default(),
                radius95_m: track.and_then(|line| line.radius95_m).unwrap_or_default(),
                // Not that of the photo: the track may have left it out.
                is_fix: track.and_then(|line| line.source) == Some(Source::Fix),
                truth: compared.map(|compared| compared.truth),
            },
            compared,
        }
    }
}

/// Names and values of the figures; empty without truth.
fn figures(scored: &[Scored]) -> Vec<(String, String)> {
    let compared: Vec<Compared> = scored.iter().filter_map(|scored| scored.compared).collect();
    if compared.is_empty() {
        return Vec::new();
    }
    let summary = summary(&compared);
    let metres = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.1} m"));
    let percent = |value: f64| format!("{:.0} %", 100.0 * value);
    [
        ("frames with truth", summary.instants.to_string()),
        ("median error", metres(summary.median_m)),
        ("90th percentile", metres(summary.p90_m)),
        ("99th percentile", metres(summary.p99_m)),
        (
            "stated radius below 10 m",
            percent(summary.availability_10m),
        ),
        (
            "stated radius below 25 m",
            percent(summary.availability_25m),
        ),
        ("longest gap", format!("{:.1} s", summary.longest_gap_s)),
        ("confidently wrong", summary.confidently_wrong.to_string()),
        (
            "95 % ellipse holds",
            summary.ellipse95_holds.map_or("-".to_owned(), percent),
        ),
    ]
    .map(|(name, value)| (name.to_owned(), value))
    .into()
}

/// The figures in one line; `None` without truth.
pub fn figures_text(scored: &[Scored]) -> Option<String> {
    let figures = figures(scored);
    let parts: Vec<String> = figures
        .iter()
        .map(|(name, value)| format!("{name} {value}"))
        .collect();
    (!parts.is_empty()).then(|| parts.join(", "))
}

/// The page of a flight.
pub fn page(title: &str, description: Vec<String>, scored: &[Scored]) -> TrackPage {
    TrackPage {
        title: title.to_owned(),
        description,
        figures: figures(scored),
        marks: scored.iter().map(|scored| scored.mark).collect(),
    }
}

/// Where the report goes, checked before the flight.
pub struct ReportFolder {
    folder: OutputFolder,
    map: Option<Box<dyn Raster>>,
}

impl ReportFolder {
    /// Opens the folder and the map.
    ///
    /// # Errors
    /// The folder may not be written, or the map cannot be read or is not that of the pack.
    pub fn open(
        folder: &Path,
        policy: &OutputPolicy,
        map: Option<&Path>,
        place: &MapPlace,
        pack: &Pack,
    ) -> Result<Self> {
        let map = map
            .map(|path| place.open_of_pack(path, policy, pack))
            .transpose()?;
        let folder = OutputFolder::open(folder, policy)?;
        folder.check([PAGE])?;
        Ok(Self { folder, map })
    }

    /// Writes the page.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn write(&self, scored: &[Scored]) -> Result<()> {
        let description = vec![format!("{} frames", scored.len())];
        let page = page("Track of a flight", description, scored);
        let html = page.to_html(self.map.as_deref())?;
        Ok(self.folder.write_bytes(PAGE, html.as_bytes())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracking::frame_time::Epoch;
    use crate::tracking::line::{FrameNote, FrameResult};

    #[test]
    fn a_fix_that_a_smoothed_track_left_out_is_no_mark_of_it() {
        let note = FrameNote {
            photo: "a.jpg".to_owned(),
            frame: FrameResult::Fix,
            reason: None,
            time_ms: 1.0,
        };
        let frame = (1.0, TrackLine::new(1.0, Epoch::Start, None, Some(note)));
        for (source, is_fix) in [(Some(Source::Fix), true), (None, false)] {
            let line = TrackLine {
                source,
                ..frame.1.clone()
            };
            let scored = Scored::of_smoothed(&frame, &[(1.0, line)], None);
            assert_eq!(scored.mark.is_fix, is_fix);
        }
    }
}
