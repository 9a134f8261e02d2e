//! The sections of EVALUATION.md on tracks, made from stored `track_summary.json` files.
//!
//! A folder holds one folder a claim, with `claim.json` ([`TrackClaim`]) and the `track_summary.json` that `grim eval --track`
//! wrote.

use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::stored::{ClaimError, read, sorted};

/// The description of a stored `track_summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackClaim {
    /// Heading of its section.
    pub title: String,
    /// What was flown.
    pub data: String,
    /// The command that measured it.
    pub command: String,
    /// Remarks on the figures.
    #[serde(default)]
    pub remarks: Vec<String>,
}

/// The runs of a summary: key and name.
const RUNS: [(&str, &str); 5] = [
    ("fixes_only", "fixes only"),
    ("motion_only", "motion only (velocity)"),
    ("filter", "**filter**"),
    (
        "motion_only_without_velocity",
        "motion only (between frames)",
    ),
    (
        "filter_without_velocity",
        "**filter**, motion between frames in place of velocity",
    ),
];

/// The sections of the claims in `folder`, in the order of their names.
///
/// # Errors
/// A stored file is missing or of another form.
pub fn sections(folder: &Path) -> Result<String, ClaimError> {
    let mut page = String::new();
    for folder in sorted(folder)? {
        let claim: TrackClaim = read(&folder.join("claim.json"))?;
        let summary: Value = read(&folder.join("track_summary.json"))?;
        section(&mut page, &claim, &summary);
    }
    Ok(page)
}

fn section(page: &mut String, claim: &TrackClaim, summary: &Value) {
    let _ = write!(
        page,
        "\n## {}\n\n{}\n\n`{}`\n",
        claim.title, claim.data, claim.command
    );
    if summary["filter"].is_object() {
        runs(page, "Rendered", summary);
        frames(page, &summary["frames"], &summary["fixes"]);
    }
    if summary["simulated"].is_object() {
        runs(page, "Simulated", &summary["simulated"]);
    }
    if let Some(rows) = summary["hidden"].as_array() {
        hidden(page, rows);
    }
    for remark in &claim.remarks {
        let _ = write!(page, "\n{remark}\n");
    }
}

fn runs(page: &mut String, what: &str, figures: &Value) {
    let _ = write!(
        page,
        "\n{what}: {} flights, {:.2} hours.\n\n\
         | | answered | median | 90 % | 99 % | radius < 5 m | < 10 m | < 25 m | longest gap | first fix | relocalised | confidently wrong | \
         95 % ellipse holds | NEES | NIS |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        figures["flights"],
        figures["hours"].as_f64().unwrap_or(0.0),
    );
    for (key, name) in RUNS {
        let run = &figures[key];
        if !run.is_object() {
            continue;
        }
        let _ = writeln!(
            page,
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} of {} | {} | {} | {} |",
            share(&run["answered"]),
            number(&run["median_m"], " m"),
            number(&run["p90_m"], " m"),
            number(&run["p99_m"], " m"),
            share(&run["availability_5m"]),
            share(&run["availability_10m"]),
            share(&run["availability_25m"]),
            number(&run["longest_gap_s"], " s"),
            number(&run["first_fix_s"], " s"),
            relocalised(run),
            run["confidently_wrong"],
            run["instants"],
            share(&run["ellipse95_holds"]),
            number(&run["mean_nees"], ""),
            number(&run["nis"]["mean"], ""),
        );
    }
}

fn frames(page: &mut String, frames: &Value, fixes: &Value) {
    let _ = write!(
        page,
        "\n{} frames, {} of them over water or snow ({} fixes there). Elsewhere {} have a right fix (median error {} on the map, NEES {}), \
         and {} of the fixes are of another place; {} of the fixes came from a window of the filter. Search and motion of such a frame \
         take {} (median; {} at 95 %). {} of the frames over town and country have a motion from the frame before. \
         The error of all motions, {} of them over water or snow, is {} of the distance (median; {} at 90 %), that of the turn {} degrees.\n",
        frames["frames"],
        frames["covered"],
        frames["covered_fixes"],
        share(&fixes["fix_rate"]),
        number(&fixes["median_m"], " m"),
        number(&fixes["mean_nees"], ""),
        share(&fixes["wrong_share"]),
        share(&frames["tracked_share"]),
        number(&frames["tracked_time_p50_ms"], " ms"),
        number(&frames["tracked_time_p95_ms"], " ms"),
        share(&frames["motion_share"]),
        frames["covered_motions"],
        share(&frames["motion_error_share_p50"]),
        share(&frames["motion_error_share_p90"]),
        number(&frames["turn_error_p50_deg"], ""),
    );
}

fn hidden(page: &mut String, rows: &[Value]) {
    page.push_str(
        "\n| hidden in a row | predictions | joined by motion | with a position | distance | last fix held | motion only | filter | \
         filter, joined | 90 %, joined | \
         stated radius | within the 95 % ellipse |\n|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for row in rows {
        let positions = row["answered"]
            .as_f64()
            .zip(row["predictions"].as_f64())
            .map_or_else(
                || "-".to_owned(),
                |(share, of)| format!("{:.0}", share * of),
            );
        let _ = writeln!(
            page,
            "| {} | {} | {} | {positions} | {} | {} | {} | {} | {} | {} | {} | {} |",
            row["hidden"],
            row["predictions"],
            row["joined"],
            number(&row["distance_median_m"], " m"),
            number(&row["fixes_only_median_m"], " m"),
            number(&row["motion_only_median_m"], " m"),
            number(&row["filter_median_m"], " m"),
            number(&row["filter_joined_median_m"], " m"),
            number(&row["filter_joined_p90_m"], " m"),
            number(&row["radius95_median_m"], " m"),
            share(&row["nees"]["within_95"]),
        );
    }
}

/// Median time after which an aircraft that was put elsewhere is found, and frames.
fn relocalised(run: &Value) -> String {
    let seconds = number(&run["relocalise_s"], " s");
    match run["relocalise_frames"].as_f64() {
        Some(frames) => format!("{seconds}, {frames:.0} frames"),
        None => seconds,
    }
}

fn share(value: &Value) -> String {
    value
        .as_f64()
        .map_or_else(|| "-".to_owned(), |v| format!("{:.1} %", 100.0 * v))
}

fn number(value: &Value, unit: &str) -> String {
    value
        .as_f64()
        .map_or_else(|| "-".to_owned(), |v| format!("{v:.1}{unit}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_run_has_a_row_and_what_is_missing_is_a_dash() {
        let folder = tempfile::tempdir().unwrap();
        let claim = folder.path().join("a");
        fs_err::create_dir_all(&claim).unwrap();
        let text = r#"{"title":"T","data":"d","command":"c","remarks":["r"]}"#;
        fs_err::write(claim.join("claim.json"), text).unwrap();
        let summary = r#"{"flights":1,"hours":0.5,"filter":{"median_m":1.94,"answered":0.5,"confidently_wrong":0,"instants":9},
            "frames":{"motion_share":0.9,"covered_motions":7,"motion_error_share_p50":0.11},
            "hidden":[{"hidden":2,"predictions":7,"joined":6,"answered":0.714}]}"#;
        fs_err::write(claim.join("track_summary.json"), summary).unwrap();
        let page = sections(folder.path()).unwrap();
        assert!(
            page.contains("| **filter** | 50.0 % | 1.9 m | - |"),
            "{page}"
        );
        // The errors are those of all motions.
        let motions = "all motions, 7 of them over water or snow, is 11.0 % of the distance";
        assert!(page.contains(motions), "{page}");
        assert!(page.contains("| 2 | 7 | 6 | 5 | - |"), "{page}");
        fs_err::remove_file(claim.join("track_summary.json")).unwrap();
        let error = sections(folder.path()).unwrap_err().to_string();
        assert!(error.contains("track_summary.json"), "{error}");
    }
}
