//! The files of an evaluation of tracks: `track_summary.json`, `track_instants.csv`, `track_frames.csv`, `track_report.html`.

use grimnet_geo::destination_en_m;
use grimnet_track::measure::Instant;
use maud::html;
use serde::Serialize;

use super::about::TrackAbout;
use super::figures::ThreeFigures;
use super::figures_table::{figures_table, number, percent};
use super::frame_figures::FrameFigures;
use super::plots;
use super::rendered::RenderedFlight;
use super::simulated::FixStatistics;
use super::three_runs::FlightRuns;
use crate::report::html;
use crate::report::results::{ResultFile, ResultsError, csv_bytes};

/// Names of the files.
pub const TRACK_FILES: [&str; 4] = [
    "track_summary.json",
    "track_instants.csv",
    "track_frames.csv",
    "track_report.html",
];

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
        let all = self
            .rendered
            .iter()
            .flat_map(|(flight, _)| &flight.flown.frames);
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
        csv_bytes(writer)
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
            for frame in &flight.flown.frames {
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
        csv_bytes(writer)
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
                " in " (about.precision) "; program " (about.version) " at commit "
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
