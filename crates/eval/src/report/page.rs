//! One self-contained HTML page of an evaluation: figures, curves, the map with answers, pictures of matches.

use base64::Engine as _;
use maud::{Markup, html};

use super::plot::{self, PlotError};
use super::{counted, html};
use crate::metrics::footprint::FootprintSummary;
use crate::metrics::reliability::Reliability;
use crate::metrics::{Frame, Summary};

/// One way of localising the same photos, such as "heading known".
#[derive(Debug, Clone)]
pub struct Run {
    /// Its name.
    pub name: String,
    /// Its photos, in the order of flight.
    pub frames: Vec<Frame>,
    /// Their figures.
    pub summary: Summary,
}

/// A picture on the page.
#[derive(Debug, Clone)]
pub struct Picture {
    /// What it shows.
    pub caption: String,
    /// JPEG bytes.
    pub jpeg: Vec<u8>,
}

/// The content of the page.
#[derive(Debug, Clone)]
pub struct Report {
    /// Its title.
    pub title: String,
    /// A line or two on what was measured: map, model, mode.
    pub description: Vec<String>,
    /// The runs, side by side.
    pub runs: Vec<Run>,
    /// The pictures.
    pub pictures: Vec<Picture>,
}

impl Report {
    /// The page as HTML; it refers to nothing outside itself.
    ///
    /// # Errors
    /// A curve cannot be drawn.
    pub fn to_html(&self) -> Result<String, PlotError> {
        let curves: Vec<(&str, &[Frame])> = self
            .runs
            .iter()
            .map(|run| (run.name.as_str(), run.frames.as_slice()))
            .collect();
        let mut figures = vec![
            (
                plot::error_distribution(&curves)?,
                "Share of all photos within a distance".to_owned(),
            ),
            (
                plot::risk_coverage(&curves)?,
                "Share of failures among the most confident answers".to_owned(),
            ),
        ];
        let reliabilities: Vec<(&str, Reliability)> = self
            .runs
            .iter()
            .filter_map(|run| Some((run.name.as_str(), Reliability::of(&run.frames)?)))
            .collect();
        if !reliabilities.is_empty() {
            figures.push((
                plot::reliability(&reliabilities)?,
                "Reliability: share of right fixes at each stated confidence, with 95 % intervals"
                    .to_owned(),
            ));
        }
        figures.push((
            plot::runs_compared(&curves)?,
            "Error of each photo, all runs (a gap is a photo without a fix)".to_owned(),
        ));
        for run in &self.runs {
            let caption = format!(
                "{}: error of each photo with the stated 95 % radius (a gap is a photo without a fix, red an error above {:.0} m)",
                run.name,
                plot::AXIS_M
            );
            figures.push((plot::error_per_frame(&run.frames)?, caption));
        }
        let content = html! {
            @for line in &self.description { p { (line) } }
            (figures_table(&self.runs))
            @for (svg, caption) in figures {
                figure { (html::svg(svg)) figcaption { (caption) } }
            }
            @for (name, reliability) in &reliabilities { (reliability_table(name, reliability)) }
            @for picture in &self.pictures { (picture_figure(picture)) }
            @for run in &self.runs { (frames_table(run)) }
        };
        Ok(html::page(&self.title, &content))
    }
}

fn picture_figure(picture: &Picture) -> Markup {
    let data = base64::engine::general_purpose::STANDARD.encode(&picture.jpeg);
    html! {
        figure {
            img alt=(picture.caption) src={ "data:image/jpeg;base64," (data) };
            figcaption { (picture.caption) }
        }
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn share(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), percent)
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"))
}

/// A row of the table of figures: its name, and its cell for a run.
type Row = (&'static str, fn(&Run) -> String);

const ROWS: [Row; 22] = [
    ("photos", |r| r.summary.frames.to_string()),
    ("fixes", |r| r.summary.fixes.to_string()),
    ("within 5 m", |r| percent(r.summary.within_5m)),
    ("within 10 m", |r| percent(r.summary.within_10m)),
    ("within 20 m", |r| percent(r.summary.within_20m)),
    ("within 25 m", |r| percent(r.summary.within_25m)),
    ("median error, a miss counted as infinite", |r| {
        metres(r.summary.median_m)
    }),
    ("90th percentile, a miss counted as infinite", |r| {
        metres(r.summary.p90_m)
    }),
    ("mean error of the fixes (ALE)", |r| metres(r.summary.ale_m)),
    ("mean error to the east", |r| metres(r.summary.bias_east_m)),
    ("mean error to the north", |r| {
        metres(r.summary.bias_north_m)
    }),
    ("confidently wrong", |r| {
        r.summary.confidently_wrong.to_string()
    }),
    ("error above 3 stated standard deviations", |r| {
        r.summary.beyond_3_sigma.to_string()
    }),
    ("truth within the stated 50 % radius", |r| {
        share(r.summary.coverage_50)
    }),
    ("truth within the stated 90 % radius", |r| {
        share(r.summary.coverage_90)
    }),
    ("truth within the stated 95 % radius", |r| {
        share(r.summary.coverage_95)
    }),
    (
        "truth within the 95 % radius enlarged by the truth's error",
        |r| share(r.summary.coverage_95_with_truth_error),
    ),
    ("median stated 95 % radius", |r| {
        metres(r.summary.radius95_median_m)
    }),
    ("median distance from the GPS position", |r| {
        metres(r.summary.gps_median_m)
    }),
    ("area under the risk-coverage curve", |r| {
        r.summary
            .risk_coverage_area
            .map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"))
    }),
    ("calibration error of the confidence", |r| {
        Reliability::of(&r.frames)
            .map_or_else(|| "-".to_owned(), |v| format!("{:.3}", v.calibration_error))
    }),
    ("median time per photo", |r| {
        r.summary
            .time_p50_ms
            .map_or_else(|| "-".to_owned(), |t| format!("{t:.0} ms"))
    }),
];

/// A row about errors as shares of the footprint: its name, and its cell for a run.
type FootprintRow = (&'static str, fn(&FootprintSummary) -> String);

/// Further rows if the ground width of photos is known.
const FOOTPRINT_ROWS: [FootprintRow; 5] = [
    ("answerable photos", |s| s.answerable.to_string()),
    ("right: within 5 % of the footprint", |s| {
        let [low, high] = s.right_share_interval;
        format!(
            "{} ({}; {:.0}-{:.0} % by place)",
            s.right,
            percent(s.right_share),
            100.0 * low,
            100.0 * high
        )
    }),
    ("wrong fixes", |s| s.wrong.to_string()),
    ("fixes neither right nor wrong", |s| s.undecided.to_string()),
    ("median error, share of the footprint", |s| {
        s.median_share
            .map_or_else(|| "-".to_owned(), |v| format!("{:.1} %", 100.0 * v))
    }),
];

fn figures_table(runs: &[Run]) -> Markup {
    let summaries: Vec<Option<FootprintSummary>> = runs
        .iter()
        .map(|run| FootprintSummary::of(&run.frames))
        .collect();
    html! {
        table {
            tr { th {} @for run in runs { th { (run.name) } } }
            @for (name, cell) in ROWS {
                tr { td { (name) } @for run in runs { td { (cell(run)) } } }
            }
            @if summaries.iter().any(Option::is_some) {
                @for (name, cell) in FOOTPRINT_ROWS {
                    tr {
                        td { (name) }
                        @for summary in &summaries {
                            td { (summary.as_ref().map_or_else(|| "-".to_owned(), cell)) }
                        }
                    }
                }
            }
        }
    }
}

fn reliability_table(name: &str, reliability: &Reliability) -> Markup {
    html! {
        details {
            summary { (name) ": fixes by stated confidence" }
            table {
                tr {
                    th { "confidence" } th { "fixes" } th { "right" } th { "mean confidence" }
                    th { "share right" } th { "95 % interval, by place" }
                }
                @for bin in &reliability.bins {
                    tr {
                        td { (format!("{:.2}-{:.2}", bin.from, bin.to)) }
                        td { (bin.fixes) }
                        td { (bin.right) }
                        td { (format!("{:.3}", bin.mean_confidence)) }
                        td { (percent(bin.right_share)) }
                        td {
                            (format!(
                                "{:.0}-{:.0} %, {}",
                                100.0 * bin.right_share_interval[0],
                                100.0 * bin.right_share_interval[1],
                                counted(bin.places, "place")
                            ))
                        }
                    }
                }
            }
        }
    }
}

fn frames_table(run: &Run) -> Markup {
    let number = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:.1}"));
    html! {
        details {
            summary { (run.name) ": every photo" }
            table {
                tr { th { "photo" } th { "error" } th { "stated 95 % radius, m" } th { "time, ms" } }
                @for frame in &run.frames {
                    tr {
                        td { (frame.photo) }
                        td {
                            @match frame.error_m {
                                Some(error_m) => { (format!("{error_m:.1} m")) }
                                None => {
                                    span class="miss" { (frame.reason.as_deref().unwrap_or("no fix")) }
                                }
                            }
                        }
                        td { (number(frame.radius95_m)) }
                        td { (number(frame.time_ms)) }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_holds_everything_and_escapes_names() {
        let frames = vec![
            Frame {
                photo: "<a>.jpg".into(),
                fixed: true,
                error_m: Some(2.0),
                ..Frame::default()
            },
            Frame::missed("b.jpg", "too dark & blurred"),
        ];
        let summary = Summary::of(&frames);
        let page = Report {
            title: "A flight <script>".into(),
            description: vec!["over nowhere".into()],
            runs: vec![Run {
                name: "heading known".into(),
                frames,
                summary,
            }],
            pictures: vec![Picture {
                caption: "map \" onload=\"x".into(),
                jpeg: vec![1, 2, 3],
            }],
        }
        .to_html()
        .unwrap();
        for part in [
            "&lt;a&gt;.jpg",
            "too dark &amp; blurred",
            "data:image/jpeg;base64,AQID",
            "map &quot; onload=&quot;x",
            "<svg",
            "50 %",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("<a>.jpg") && !page.contains("<script>"));
    }
}
