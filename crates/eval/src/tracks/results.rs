//! The files of an evaluation of tracks: `track_summary.json`, `track_instants.csv`, `track_frames.csv`, `track_report.html`.

use grimnet_geo::destination_en_m;
use grimnet_track::measure::Instant;
use maud::{Markup, html};
use serde::Serialize;

use super::figures::{Consistency, RunFigures, ThreeFigures};
use super::frame_record::FrameRecord;
use super::hidden::{HiddenFigures, Prediction};
use super::plots;
use super::rendered::RenderedFlight;
use super::simulated::FixStatistics;
use super::three_runs::FlightRuns;
use crate::metrics::statistics::percentile;
use crate::report::html;
use crate::report::results::{ResultFile, ResultsError};

/// Names of the files.
pub const TRACK_FILES: [&str; 4] = [
    "track_summary.json",
    "track_instants.csv",
    "track_frames.csv",
    "track_report.html",
];

/// Names of the files of hidden fixes.
pub const HIDDEN_FILES: [&str; 3] = [
    "track_summary.json",
    "track_predictions.csv",
    "track_report.html",
];

/// Conditions of the measurement.
#[derive(Debug, Clone, Serialize)]
pub struct TrackAbout {
    /// What was flown.
    pub data: String,
    /// Identity of the model.
    pub model_hash: String,
    /// Commit that the program was built from, if given.
    pub commit: Option<String>,
    /// Version of the program.
    pub version: &'static str,
    /// Threads that searched.
    pub threads: usize,
}

/// Figures of rendered frames.
#[derive(Debug, Clone, Serialize)]
pub struct FrameFigures {
    /// Frames.
    pub frames: usize,
    /// Frames over water and snow.
    pub covered: usize,
    /// Fixes on frames over water and snow.
    pub covered_fixes: usize,
    /// Share of fixes that a window of the filter gave.
    pub tracked_share: f64,
    /// Median time of a tracked frame: search and motion, without rendering and decoding, milliseconds.
    pub tracked_time_p50_ms: Option<f64>,
    /// 95th percentile of it.
    pub tracked_time_p95_ms: Option<f64>,
    /// Frames, without covered ones, with a motion from the frame before.
    pub motion_share: f64,
    /// Motions on covered frames.
    pub covered_motions: usize,
    /// Median error of a motion over its distance.
    pub motion_error_share_p50: Option<f64>,
    /// 90th percentile of it.
    pub motion_error_share_p90: Option<f64>,
    /// Median absolute error of the turn, degrees.
    pub turn_error_p50_deg: Option<f64>,
    /// Squared errors of motions over twice the stated variance per axis with 7 % of the distance added.
    pub motion_nees: Option<Consistency>,
}

/// Error of motion between frames relative to the distance, as the filter's options have it.
const MOTION_SIGMA: f64 = 0.07;

impl FrameFigures {
    /// Of all frames.
    #[must_use]
    pub fn of<'a>(frames: impl Iterator<Item = &'a FrameRecord> + Clone) -> Self {
        let open = frames.clone().filter(|frame| frame.cover.is_none());
        let covered = frames.clone().filter(|frame| frame.cover.is_some());
        let fixes = frames.clone().filter(|frame| frame.fix.is_some());
        let tracked = fixes.clone().filter(|frame| frame.tracked);
        let times: Vec<f64> = tracked.clone().map(|frame| frame.time_ms).collect();
        let motions: Vec<_> = frames.clone().filter_map(|frame| frame.motion).collect();
        let of = |value: fn(&super::frame_record::MeasuredMotion) -> f64| -> Vec<f64> {
            motions.iter().map(value).collect()
        };
        let shares = of(|m| m.error_m / m.distance_m.max(1.0));
        let turns = of(|m| m.turn_error_deg.abs());
        let nees =
            of(|m| m.error_m.powi(2) / (m.sigma_m.powi(2) + (MOTION_SIGMA * m.distance_m).powi(2)));
        let share = |part: usize, all: usize| part as f64 / all.max(1) as f64;
        let is_joined = |frame: &&FrameRecord| frame.motion.is_some();
        Self {
            frames: frames.clone().count(),
            covered: covered.clone().count(),
            covered_fixes: covered.clone().filter(|frame| frame.fix.is_some()).count(),
            tracked_share: share(times.len(), fixes.count()),
            tracked_time_p50_ms: percentile(&times, 0.5),
            tracked_time_p95_ms: percentile(&times, 0.95),
            motion_share: share(open.clone().filter(is_joined).count(), open.count()),
            covered_motions: covered.filter(is_joined).count(),
            motion_error_share_p50: percentile(&shares, 0.5),
            motion_error_share_p90: percentile(&shares, 0.9),
            turn_error_p50_deg: percentile(&turns, 0.5),
            motion_nees: Consistency::of(&nees),
        }
    }
}

/// Everything that was measured on rendered and simulated flights.
#[derive(Debug, Clone)]
pub struct TrackResults {
    /// The conditions.
    pub about: TrackAbout,
    /// The rendered flights with their runs.
    pub rendered: Vec<(RenderedFlight, FlightRuns)>,
    /// Figures of the rendered flights.
    pub figures: ThreeFigures,
    /// Statistics of their fixes.
    pub fixes: FixStatistics,
    /// Figures of simulated flights, if there were any.
    pub simulated: Option<ThreeFigures>,
}

#[derive(Serialize)]
struct Summary<'a> {
    about: &'a TrackAbout,
    #[serde(flatten)]
    figures: &'a ThreeFigures,
    frames: &'a FrameFigures,
    fixes: &'a FixStatistics,
    simulated: Option<&'a ThreeFigures>,
}

impl TrackResults {
    /// The files.
    ///
    /// # Errors
    /// A curve cannot be drawn, or a figure not be written.
    pub fn files(&self) -> Result<[ResultFile; 4], ResultsError> {
        let all = self.rendered.iter().flat_map(|(flight, _)| &flight.frames);
        let frames = FrameFigures::of(all);
        let summary = Summary {
            about: &self.about,
            figures: &self.figures,
            frames: &frames,
            fixes: &self.fixes,
            simulated: self.simulated.as_ref(),
        };
        let [summary_name, instants_name, frames_name, report_name] = TRACK_FILES;
        Ok([
            (
                summary_name,
                (serde_json::to_string_pretty(&summary)? + "\n").into_bytes(),
            ),
            (instants_name, self.instants_csv()?),
            (frames_name, self.frames_csv()?),
            (report_name, self.report(&frames)?.into_bytes()),
        ])
    }

    fn instants_csv(&self) -> Result<Vec<u8>, ResultsError> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record([
            "flight",
            "run",
            "time_s",
            "true_lat_deg",
            "true_lon_deg",
            "lat_deg",
            "lon_deg",
            "error_m",
            "radius95_m",
            "covariance_ee_m2",
            "covariance_en_m2",
            "covariance_nn_m2",
            "nees",
        ])?;
        for (flight, runs) in &self.rendered {
            for (name, instants) in named_runs(runs) {
                for instant in instants {
                    let truth = flight.flight.truth_at(instant.time_s);
                    let mut record = vec![
                        flight.name.clone(),
                        name.to_owned(),
                        format!("{:.2}", instant.time_s),
                        format!("{:.8}", truth.lat_deg),
                        format!("{:.8}", truth.lon_deg),
                    ];
                    record.extend(match &instant.answer {
                        Some(answer) => {
                            let [east_m, north_m] = answer.error_en_m;
                            let place = destination_en_m(truth, east_m, north_m);
                            let [ee, en, nn] = answer.covariance_en_m2;
                            [
                                format!("{:.8}", place.lat_deg),
                                format!("{:.8}", place.lon_deg),
                                format!("{:.3}", answer.error_m()),
                                format!("{:.3}", answer.radius95_m),
                                format!("{ee:.4}"),
                                format!("{en:.4}"),
                                format!("{nn:.4}"),
                                answer.nees().map(|v| format!("{v:.3}")).unwrap_or_default(),
                            ]
                        }
                        None => Default::default(),
                    });
                    writer.write_record(record)?;
                }
            }
        }
        finish(writer)
    }

    fn frames_csv(&self) -> Result<Vec<u8>, ResultsError> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record([
            "flight",
            "time_s",
            "cover",
            "tracked",
            "fix_error_m",
            "fix_nees",
            "confidence",
            "motion_distance_m",
            "motion_error_m",
            "motion_sigma_m",
            "turn_error_deg",
            "time_ms",
        ])?;
        let number = |value: Option<f64>| value.map(|v| format!("{v:.3}")).unwrap_or_default();
        for (flight, _) in &self.rendered {
            for frame in &flight.frames {
                let motion = |value: fn(&super::frame_record::MeasuredMotion) -> f64| {
                    number(frame.motion.as_ref().map(value))
                };
                writer.write_record([
                    flight.name.clone(),
                    format!("{:.2}", frame.time_s),
                    frame
                        .cover
                        .map(|cover| format!("{cover:?}").to_lowercase())
                        .unwrap_or_default(),
                    frame.tracked.to_string(),
                    number(frame.fix.map(|fix| fix.error_m)),
                    number(frame.fix.and_then(|fix| fix.nees())),
                    number(frame.fix.map(|fix| fix.sample.confidence)),
                    motion(|m| m.distance_m),
                    motion(|m| m.error_m),
                    motion(|m| m.sigma_m),
                    motion(|m| m.turn_error_deg),
                    format!("{:.1}", frame.time_ms),
                ])?;
            }
        }
        finish(writer)
    }

    fn report(&self, frames: &FrameFigures) -> Result<String, ResultsError> {
        let mut figures = vec![(
            plots::error_distribution(&self.all_runs())?,
            "Share of instants within a distance".to_owned(),
        )];
        for (flight, runs) in &self.rendered {
            let track = &runs.with_velocity.filter;
            let about = format!("{}: the filter's error and stated radius", flight.name);
            figures.push((plots::error_over_time(track, &flight.legs)?, about));
            figures.push((
                plots::path(flight, track)?,
                format!("{}: path", flight.name),
            ));
        }
        let about = &self.about;
        let content = html! {
            p {
                "Model " (&about.model_hash[..about.model_hash.len().min(16)])
                "; program " (about.version) " at commit "
                (about.commit.as_deref().unwrap_or("not given")) "; "
                (about.threads) " threads."
            }
            h2 { "Rendered flights" }
            (figures_table(&self.figures))
            p {
                (frames.frames) " frames, " (frames.covered) " of them over water or snow ("
                (frames.covered_fixes) " fixes there). Tracked frame: "
                (number(frames.tracked_time_p50_ms, "ms")) " (median), "
                (number(frames.tracked_time_p95_ms, "ms"))
                " (95th percentile). Motion between frames: median error "
                (percent(frames.motion_error_share_p50)) " of the distance."
            }
            @if let Some(simulated) = &self.simulated {
                h2 { "Simulated flights" }
                p {
                    (simulated.flights) " flights, " (format!("{:.1}", simulated.hours)) " hours, with "
                    @if self.fixes.is_enough() { "fixes drawn from the rendered ones, and " }
                    "10-40 % of aliases that repeat from frame to frame."
                }
                (figures_table(simulated))
            }
            @for (svg, caption) in figures {
                figure { (html::svg(svg)) figcaption { (caption) } }
            }
        };
        Ok(html::page(&format!("Tracks over {}", about.data), &content))
    }

    fn all_runs(&self) -> Vec<(&'static str, Vec<&Instant>)> {
        let Some((_, first)) = self.rendered.first() else {
            return Vec::new();
        };
        (0..named_runs(first).len())
            .map(|index| {
                let instants = self
                    .rendered
                    .iter()
                    .flat_map(|(_, runs)| named_runs(runs)[index].1)
                    .collect();
                (named_runs(first)[index].0, instants)
            })
            .collect()
    }
}

/// The runs of a flight with their names.
fn named_runs(runs: &FlightRuns) -> [(&'static str, &[Instant]); 4] {
    [
        ("fixes only", &runs.with_velocity.fixes_only),
        ("motion only", &runs.with_velocity.motion_only),
        ("filter", &runs.with_velocity.filter),
        ("filter without velocity", &runs.without_velocity.filter),
    ]
}

fn finish(writer: csv::Writer<Vec<u8>>) -> Result<Vec<u8>, ResultsError> {
    writer
        .into_inner()
        .map_err(|error| ResultsError::Csv(error.into_error().into()))
}

fn number(value: Option<f64>, unit: &str) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} {unit}"))
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |v| format!("{:.1} %", 100.0 * v))
}

/// A row: its name, and its cell for a run.
type Row = (&'static str, fn(&RunFigures) -> String);

/// The figures of a run, for tables.
pub const ROWS: [Row; 14] = [
    ("answered", |r| percent(Some(r.track.answered))),
    ("median error", |r| number(r.track.median_m, "m")),
    ("90th percentile", |r| number(r.track.p90_m, "m")),
    ("99th percentile", |r| number(r.track.p99_m, "m")),
    ("stated radius below 5 m", |r| {
        percent(Some(r.track.availability_5m))
    }),
    ("stated radius below 10 m", |r| {
        percent(Some(r.track.availability_10m))
    }),
    ("stated radius below 25 m", |r| {
        percent(Some(r.track.availability_25m))
    }),
    ("longest gap", |r| number(Some(r.track.longest_gap_s), "s")),
    ("first fix after", |r| number(r.first_fix_s, "s")),
    ("relocalised after", |r| number(r.relocalise_s, "s")),
    ("confidently wrong instants", |r| {
        r.track.confidently_wrong.to_string()
    }),
    ("95 % ellipse holds", |r| percent(r.track.ellipse95_holds)),
    ("mean NEES (2 expected)", |r| number(r.track.mean_nees, "")),
    ("mean NIS (2 expected)", |r| {
        number(r.nis.map(|nis| nis.mean), "")
    }),
];

fn figures_table(figures: &ThreeFigures) -> Markup {
    html! {
        table {
            tr {
                th { (format!("{} flights, {:.2} h", figures.flights, figures.hours)) }
                @for (name, _) in figures.runs() { th { (name) } }
            }
            @for (name, cell) in ROWS {
                tr {
                    td { (name) }
                    @for (_, run) in figures.runs() { td { (cell(run)) } }
                }
            }
        }
    }
}

/// The files of an evaluation with hidden fixes.
///
/// # Errors
/// A figure cannot be written.
pub fn hidden_files(
    about: &TrackAbout,
    figures: &[HiddenFigures],
    predictions: &[Prediction],
) -> Result<[ResultFile; 3], ResultsError> {
    #[derive(Serialize)]
    struct HiddenSummary<'a> {
        about: &'a TrackAbout,
        hidden: &'a [HiddenFigures],
    }
    let summary = HiddenSummary {
        about,
        hidden: figures,
    };
    let mut writer = csv::Writer::from_writer(Vec::new());
    for prediction in predictions {
        writer.serialize(prediction)?;
    }
    let content = html! {
        p { "Fixes of one to four photos in a row are hidden and predicted from the motion between the photos." }
        table {
            tr {
                th { "hidden" } th { "predictions" } th { "joined" } th { "distance" } th { "fixes only" }
                th { "motion only" } th { "filter" } th { "filter, joined" } th { "90th percentile" }
                th { "stated radius" } th { "within the 95 % ellipse" }
            }
            @for f in figures {
                tr {
                    td { (f.hidden) } td { (f.predictions) } td { (f.joined) }
                    td { (number(f.distance_median_m, "m")) }
                    td { (number(f.fixes_only_median_m, "m")) }
                    td { (number(f.motion_only_median_m, "m")) }
                    td { (number(f.filter_median_m, "m")) }
                    td { (number(f.filter_joined_median_m, "m")) }
                    td { (number(f.filter_joined_p90_m, "m")) }
                    td { (number(f.radius95_median_m, "m")) }
                    td { (percent(f.nees.map(|nees| nees.within_95))) }
                }
            }
        }
    };
    let [summary_name, predictions_name, report_name] = HIDDEN_FILES;
    let page = html::page(&format!("Hidden fixes of {}", about.data), &content);
    Ok([
        (
            summary_name,
            (serde_json::to_string_pretty(&summary)? + "\n").into_bytes(),
        ),
        (predictions_name, finish(writer)?),
        (report_name, page.into_bytes()),
    ])
}
