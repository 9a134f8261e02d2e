//! The content of the files of an evaluation: `summary.json`, `frames.csv`, `failed.jsonl`, `report.html`.

use grimnet_geo::LonLat;
use grimnet_net::{Calibration, Precision};
use serde::Serialize;

use super::page::{Picture, Report, Run};
use super::plot::PlotError;
use crate::metrics::Frame;
use crate::metrics::footprint::{FootprintSummary, is_right, is_wrong};
use crate::metrics::reliability::Reliability;

/// Why results cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ResultsError {
    /// The table of photos cannot be written.
    #[error("cannot write the table of photos: {0}")]
    Csv(#[from] csv::Error),
    /// The summary cannot be written as JSON.
    #[error("cannot write the summary: {0}")]
    Json(#[from] serde_json::Error),
    /// A curve cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}

/// Conditions of the measurement; `about` in `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct About {
    /// What was localised.
    pub data: String,
    /// What the map is.
    pub map: String,
    /// `default` or `paper`.
    pub mode: String,
    /// Identity of the model.
    pub model_hash: String,
    /// Precision of the network.
    #[serde(skip_serializing_if = "Precision::is_f32")]
    pub precision: Precision,
    /// Whether the model is calibrated.
    pub model_calibrated: bool,
    /// The calibration: models of one identity may have several.
    pub calibration: Calibration,
    /// Commit that the program was built from, if given.
    pub commit: Option<String>,
    /// Version of the program.
    pub version: &'static str,
    /// Error of the map included in the stated radii, metres (1 sigma per axis).
    pub map_error_m: f64,
    /// Error of the truth, metres (1 sigma per axis), if given for all photos.
    pub truth_error_m: Option<f64>,
    /// Ground width of the photos, metres, if given for all photos.
    pub footprint_width_m: Option<f64>,
    /// Least confidence of a fix, if given; otherwise that of the model's calibration.
    pub min_confidence: Option<f64>,
    /// Whose batch-normalisation statistics were used: `none` (the model's), `photo` or `flight`.
    pub adapt: String,
    /// The only ground resolution of the pack, metres per pixel, if given.
    pub gsd_m: Option<f64>,
    /// Size of the pack per area of the map.
    pub pack_bytes_per_km2: f64,
    /// Peak memory of the program, MiB; `None` if the system does not report it.
    pub peak_memory_mib: Option<f64>,
}

impl About {
    fn lines(&self, runs: &[Run]) -> Vec<String> {
        let truth = of_photos(runs, self.truth_error_m, |frame| frame.truth_error_m);
        let width = of_photos(runs, self.footprint_width_m, |frame| {
            frame.footprint_width_m
        });
        let usual_confidence = if self.mode == "paper" {
            "none, paper mode always answers"
        } else {
            "that of the model's calibration"
        };
        vec![
            format!("Map {}.", self.map),
            format!(
                "Mode {}; model {} in {} ({}); program {} at commit {}.",
                self.mode,
                &self.model_hash[..self.model_hash.len().min(16)],
                self.precision,
                if self.model_calibrated {
                    "calibrated"
                } else {
                    "not calibrated: default radii"
                },
                self.version,
                self.commit.as_deref().unwrap_or("not given"),
            ),
            format!(
                "Stated radii include a map error of {} m per axis (1 sigma). Error of the truth: {}. Ground width of the photos: {}.",
                self.map_error_m, truth, width
            ),
            format!(
                "Least confidence of a fix: {}. Batch-normalisation statistics recomputed: {}. Ground resolution: {}.",
                self.min_confidence
                    .map_or_else(|| usual_confidence.to_owned(), |p| p.to_string()),
                self.adapt,
                self.gsd_m.map_or_else(
                    || "all levels of the map".to_owned(),
                    |gsd_m| format!("{gsd_m} m/px alone")
                )
            ),
            format!(
                "Pack {:.1} MB/km2; peak memory {}.",
                self.pack_bytes_per_km2 / 1e6,
                self.peak_memory_mib
                    .map_or_else(|| "unknown".to_owned(), |v| format!("{v:.0} MiB"))
            ),
        ]
    }
}

/// What was given of all photos, metres, and whether the data set states it of some.
fn of_photos(runs: &[Run], given: Option<f64>, stated: fn(&Frame) -> Option<f64>) -> String {
    let mut all = runs.iter().flat_map(|run| &run.frames).filter_map(stated);
    let has_other = all.any(|value| Some(value) != given);
    match (given, has_other) {
        (Some(value_m), false) => format!("{value_m} m"),
        (Some(value_m), true) => format!("{value_m} m where the truth file states none"),
        (None, true) => "that of the truth file, where it states one".to_owned(),
        (None, false) => "not given".to_owned(),
    }
}

/// Peak memory of this process so far, MiB (Linux).
#[must_use]
pub fn peak_memory_mib() -> Option<f64> {
    let status = fs_err::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

/// A file of results: its name and content.
pub type ResultFile = (&'static str, Vec<u8>);

/// Names of the files that [`files`] makes.
pub const FILE_NAMES: [&str; 4] = ["summary.json", "frames.csv", "failed.jsonl", "report.html"];

/// Makes the files of an evaluation: `summary.json`, `frames.csv`, `failed.jsonl` and `report.html`.
///
/// # Errors
/// A curve cannot be drawn, or a figure not be written as JSON.
pub fn files(
    title: String,
    about: &About,
    runs: &[Run],
    pictures: Vec<Picture>,
) -> Result<[ResultFile; 4], ResultsError> {
    let report = Report {
        title,
        description: about.lines(runs),
        runs: runs.to_vec(),
        pictures,
    };
    let about = serde_json::to_value(about)?;
    let [summary, frames, failed, page] = FILE_NAMES;
    Ok([
        (summary, summary_json(Some(about), runs)?.into_bytes()),
        (frames, frames_csv(runs)?),
        (failed, failed_lines(runs).into_bytes()),
        (page, report.to_html()?.into_bytes()),
    ])
}

/// The columns of `frames.csv`.
const COLUMNS: [&str; 26] = [
    "run",
    "photo",
    "state",
    "error_m",
    "error_east_m",
    "error_north_m",
    "radius95_m",
    "reason",
    "time_ms",
    "confidence",
    "inliers",
    "gps_error_m",
    "place",
    "footprint_w_m",
    "footprint_share",
    "tilt_deg",
    "truth_err_m",
    "answerable",
    "verdict",
    "true_lat_deg",
    "true_lon_deg",
    "lat_deg",
    "lon_deg",
    "covariance_ee_m2",
    "covariance_en_m2",
    "covariance_nn_m2",
];

fn frames_csv(runs: &[Run]) -> Result<Vec<u8>, ResultsError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(COLUMNS)?;
    let number = |v: Option<f64>| v.map(|v| format!("{v:.3}")).unwrap_or_default();
    let text = |v: Option<String>| v.unwrap_or_default();
    for run in runs {
        for frame in &run.frames {
            let [true_lat, true_lon] = coordinates(frame.truth);
            let [lat, lon] = coordinates(frame.stated.map(|fix| fix.position));
            let [ee, en, nn] = frame.stated.map_or_else(<[String; 3]>::default, |fix| {
                fix.covariance_en_m2.map(|value| value.to_string())
            });
            writer.write_record([
                run.name.clone(),
                frame.photo.clone(),
                if frame.fixed { "fix" } else { "no_fix" }.to_owned(),
                number(frame.error_m),
                number(frame.error_east_m),
                number(frame.error_north_m),
                number(frame.radius95_m),
                text(frame.reason.clone()),
                number(frame.time_ms),
                text(frame.confidence.map(|v| format!("{v:.6}"))),
                text(frame.inliers.map(|v| v.to_string())),
                number(frame.gps_error_m),
                text(frame.place.clone()),
                number(frame.footprint_width_m),
                text(frame.footprint_share().map(|v| format!("{v:.5}"))),
                number(frame.tilt_deg),
                number(frame.truth_error_m),
                text(frame.answerable.map(|v| v.to_string())),
                verdict(frame).to_owned(),
                true_lat,
                true_lon,
                lat,
                lon,
                ee,
                en,
                nn,
            ])?;
        }
    }
    csv_bytes(writer)
}

/// Latitude and longitude, degrees; empty without a place.
fn coordinates(place: Option<LonLat>) -> [String; 2] {
    place.map_or_else(<[String; 2]>::default, |place| {
        [place.lat_deg, place.lon_deg].map(|degrees| format!("{degrees:.8}"))
    })
}

/// Whether the fix of a photo is right (see [`crate::metrics::footprint`]); empty without a fix.
fn verdict(frame: &Frame) -> &'static str {
    match (frame.fixed, is_right(frame), is_wrong(frame)) {
        (false, ..) => "",
        (_, true, _) => "right",
        (_, _, true) => "wrong",
        _ => "undecided",
    }
}

fn failed_lines(runs: &[Run]) -> String {
    let mut lines = String::new();
    for run in runs {
        for frame in run.frames.iter().filter(|frame| !frame.fixed) {
            let line = serde_json::json!({ "run": run.name, "photo": frame.photo, "reason": frame.reason });
            lines.push_str(&format!("{line}\n"));
        }
    }
    lines
}

/// The figures of each run under its name with underscores, such as `heading_known`, after `about` if that is given.
///
/// # Errors
/// A figure cannot be written as JSON.
pub fn summary_json(
    about: Option<serde_json::Value>,
    runs: &[Run],
) -> Result<String, ResultsError> {
    let mut summary = serde_json::Map::new();
    if let Some(about) = about {
        summary.insert("about".to_owned(), about);
    }
    for run in runs {
        let mut figures = serde_json::to_value(&run.summary)?;
        if let Some(fields) = figures.as_object_mut() {
            if let Some(footprint) = FootprintSummary::of(&run.frames) {
                fields.insert("footprint".to_owned(), serde_json::to_value(footprint)?);
            }
            if let Some(reliability) = Reliability::of(&run.frames) {
                fields.insert("reliability".to_owned(), serde_json::to_value(reliability)?);
            }
        }
        summary.insert(run.name.replace(' ', "_"), figures);
    }
    Ok(serde_json::to_string_pretty(&summary)? + "\n")
}
/// What was written.
///
/// # Errors
/// The writer cannot be flushed.
pub(crate) fn csv_bytes(writer: csv::Writer<Vec<u8>>) -> Result<Vec<u8>, ResultsError> {
    writer
        .into_inner()
        .map_err(|error| ResultsError::Csv(error.into_error().into()))
}
