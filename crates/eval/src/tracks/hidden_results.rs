//! The files of an evaluation with hidden fixes: `track_summary.json`, `track_predictions.csv`, `track_report.html`.

use maud::html;
use serde::Serialize;

use super::about::TrackAbout;
use super::figures_table::{number, percent};
use super::hidden::Prediction;
use super::hidden_figures::HiddenFigures;
use crate::report::html;
use crate::report::results::{ResultFile, ResultsError, csv_bytes};

/// Names of the files of hidden fixes.
pub const HIDDEN_FILES: [&str; 3] = [
    "track_summary.json",
    "track_predictions.csv",
    "track_report.html",
];

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
                th { "hidden" } th { "predictions" } th { "joined" } th { "answered" } th { "distance" } th { "fixes only" }
                th { "motion only" } th { "filter" } th { "filter, joined" } th { "90th percentile" }
                th { "stated radius" } th { "within the 95 % ellipse" }
            }
            @for f in figures {
                tr {
                    td { (f.hidden) } td { (f.predictions) } td { (f.joined) }
                    td { (percent(Some(f.answered))) }
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
        (predictions_name, csv_bytes(writer)?),
        (report_name, page.into_bytes()),
    ])
}
