//! EVALUATION.md: the published figures of accuracy, made from stored `summary.json` files.
//!
//! A folder holds one folder a claim, with `claim.json` ([`Claim`]) and the `summary.json` that `grim eval` wrote, and
//! `tracks/` ([`crate::track_claims`]), `experiments/`, with the tables of `grim-experiments`, and `paper.md`, the table of
//! what follows the publication and what differs. The page is made by
//! `cargo run -p grimnet-experiments --example evaluation`; a test fails if the page and the stored figures differ.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::experiment_table::ExperimentTable;
use crate::track_claims::{self, TrackClaimError};

/// The description of a stored `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Heading of its section.
    pub title: String,
    /// Photos, map and truth.
    pub data: String,
    /// The command that measured it.
    pub command: String,
    /// Figures of other systems on the same photos.
    #[serde(default)]
    pub peers: Vec<Peer>,
    /// Remarks on the figures.
    #[serde(default)]
    pub remarks: Vec<String>,
}

/// Another system's figures on the same frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Peer {
    /// Its name.
    pub name: String,
    /// The run that it is compared with, such as `heading_known`.
    pub run: String,
    /// Share of all frames within 5 m.
    pub within_5m: f64,
    /// Share of all frames within 10 m.
    pub within_10m: f64,
    /// Share of all frames within 20 m.
    pub within_20m: f64,
    /// Median error, metres.
    pub median_m: f64,
    /// Who measured it, and how.
    pub source: String,
}

/// Why the page cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClaimError {
    /// A file or folder cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A file is no JSON of the expected form.
    #[error("{path}: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// The sections on tracks cannot be made.
    #[error(transparent)]
    Tracks(#[from] TrackClaimError),
    /// An experiment's table cannot be read.
    #[error(transparent)]
    Table(#[from] crate::experiment_table::TableError),
}

const HEAD: &str = "\
# Evaluation

Made from the stored figures under `evaluation/` by `cargo run -p grimnet-experiments --example evaluation`; do not edit. Shares are of
all photos; a photo without a fix is a miss. \"Behind\" marks figures of this program that are worse than another system's on the same photos.

Model 678b86b95a38 is the bundled one (279c4ec9bb6e) with its whitening in half precision, as it was stored at first; crates/net/models/README.md
compares the two.
";

/// From the page to the curves of the experiments.
const FIGURES: &str = "evaluation/experiments/";

/// The table "the paper and this program", kept by hand.
const PAPER_TABLE: &str = "paper.md";

/// The page for the claims stored in `folder`.
///
/// # Errors
/// A stored file is missing or of another form.
pub fn page(folder: &Path) -> Result<String, ClaimError> {
    let mut page = HEAD.to_owned();
    for folder in sorted(folder)?
        .iter()
        .filter(|path| path.join("claim.json").is_file())
    {
        let claim: Claim = read(&folder.join("claim.json"))?;
        let summary: Value = read(&folder.join("summary.json"))?;
        section(&mut page, &claim, &summary);
    }
    let tracks = folder.join("tracks");
    if tracks.is_dir() {
        page.push_str(&track_claims::sections(&tracks)?);
    }
    let paper = folder.join(PAPER_TABLE);
    if paper.is_file() {
        let _ = write!(page, "\n{}", fs_err::read_to_string(&paper)?);
    }
    let experiments = folder.join("experiments");
    if experiments.is_dir() {
        page.push_str("\n## The paper's experiments and sweeps\n");
        for path in sorted(&experiments)? {
            if path.extension().is_some_and(|e| e == "json") {
                let _ = write!(
                    page,
                    "\n{}",
                    ExperimentTable::read(&path)?.to_markdown(FIGURES)
                );
            }
        }
    }
    Ok(page)
}

fn sorted(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = fs_err::read_dir(folder)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    paths.sort();
    Ok(paths)
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, ClaimError> {
    serde_json::from_slice(&fs_err::read(path)?).map_err(|source| ClaimError::Json {
        path: path.to_owned(),
        source,
    })
}

/// A column of a claim's table.
struct Column {
    name: &'static str,
    key: &'static str,
    of_peer: fn(&Peer) -> f64,
    is_share: bool,
}

const COMPARED: [Column; 4] = [
    Column {
        name: "within 5 m",
        key: "within_5m",
        of_peer: |p| p.within_5m,
        is_share: true,
    },
    Column {
        name: "10 m",
        key: "within_10m",
        of_peer: |p| p.within_10m,
        is_share: true,
    },
    Column {
        name: "20 m",
        key: "within_20m",
        of_peer: |p| p.within_20m,
        is_share: true,
    },
    Column {
        name: "median",
        key: "median_m",
        of_peer: |p| p.median_m,
        is_share: false,
    },
];

impl Column {
    fn text(&self, value: Option<f64>) -> String {
        match value {
            None => "-".to_owned(),
            Some(v) if self.is_share => percent(Some(v)),
            Some(v) => format!("{v:.1} m"),
        }
    }

    /// Whether `ours` is worse than `theirs` by more than both are printed to.
    fn is_behind(&self, ours: Option<f64>, theirs: f64) -> bool {
        match ours {
            None => true,
            Some(ours) if self.is_share => (100.0 * theirs).round() > (100.0 * ours).round(),
            Some(ours) => (10.0 * theirs).round() < (10.0 * ours).round(),
        }
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{:.0} %", 100.0 * v))
}

/// Adds a claim: its conditions, the comparison with peers, and the other figures.
fn section(page: &mut String, claim: &Claim, summary: &Value) {
    conditions(page, claim, &summary["about"]);
    let runs = runs(summary);
    comparison(page, claim, &runs);
    other_figures(page, &runs);
    footprint_shares(page, &runs);
    reliability(page, &runs);
    for remark in &claim.remarks {
        put(page, format_args!("\n{remark}\n"));
    }
}

fn put(page: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = page.write_fmt(text);
}

fn conditions(page: &mut String, claim: &Claim, about: &Value) {
    let mut put = |text: std::fmt::Arguments<'_>| put(page, text);
    put(format_args!("\n## {}\n\n{}\n\n", claim.title, claim.data));
    let text = |key: &str| match &about[key] {
        Value::Null => "not given".to_owned(),
        Value::String(text) => text.chars().take(16).collect(),
        other => other.to_string(),
    };
    put(format_args!(
        "`{}`\n\nMode {}, model {} ({}), program {} at commit {}, map error in the radii {} m, error of the truth {}.\n\n",
        claim.command,
        text("mode"),
        text("model_hash"),
        if about["model_calibrated"] == true {
            "calibrated"
        } else {
            "not calibrated"
        },
        text("version"),
        text("commit"),
        text("map_error_m"),
        about["truth_error_m"].as_f64().map_or_else(
            || "as each photo states it, if it does".to_owned(),
            |error_m| format!("{error_m} m per axis")
        ),
    ));
}

/// The runs beside the peers.
fn comparison(page: &mut String, claim: &Claim, runs: &[(&String, &Value)]) {
    let mut put = |text: std::fmt::Arguments<'_>| put(page, text);
    put(format_args!("| |"));
    for column in &COMPARED {
        put(format_args!(" {} |", column.name));
    }
    put(format_args!(" |\n|---|"));
    for _ in &COMPARED {
        put(format_args!("---:|"));
    }
    put(format_args!("---|\n"));
    for (name, run) in runs {
        put(format_args!("| **grimnet**, {} |", name.replace('_', " ")));
        let mut behind = Vec::new();
        for column in &COMPARED {
            let ours = run[column.key].as_f64();
            put(format_args!(" {} |", column.text(ours)));
            for peer in claim.peers.iter().filter(|peer| peer.run == **name) {
                if column.is_behind(ours, (column.of_peer)(peer)) {
                    behind.push(format!("behind {} ({})", peer.name, column.name));
                }
            }
        }
        put(format_args!(" {} |\n", behind.join("; ")));
        for peer in claim.peers.iter().filter(|peer| peer.run == **name) {
            put(format_args!("| {} |", peer.name));
            for column in &COMPARED {
                put(format_args!(
                    " {} |",
                    column.text(Some((column.of_peer)(peer)))
                ));
            }
            put(format_args!(" {} |\n", peer.source));
        }
    }
}

fn other_figures(page: &mut String, runs: &[(&String, &Value)]) {
    let mut put = |text: std::fmt::Arguments<'_>| put(page, text);
    put(format_args!(
        "\n| | fixes | fixes within 20 m | confidently wrong | error above 3 sigma | stated 95 % radius | truth within it | with the error of the truth | mean error | mean error east, north | time per photo |\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n"
    ));
    for (name, run) in runs {
        let metres = |key: &str| {
            run[key]
                .as_f64()
                .map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"))
        };
        put(format_args!(
            "| {} | {} of {} | {} | {} | {} | {} | {} | {} | {} | {}, {} | {} ms |\n",
            name.replace('_', " "),
            run["fixes"],
            run["frames"],
            percent(run["precision"].as_f64()),
            run["confidently_wrong"],
            run["beyond_3_sigma"],
            metres("radius95_median_m"),
            percent(run["coverage_95"].as_f64()),
            percent(run["coverage_95_with_truth_error"].as_f64()),
            metres("ale_m"),
            metres("bias_east_m"),
            metres("bias_north_m"),
            run["time_p50_ms"].as_f64().map_or(f64::NAN, f64::round),
        ));
    }
}

/// Errors as a share of the footprint, where the data set gives each photo's.
fn footprint_shares(page: &mut String, runs: &[(&String, &Value)]) {
    let of_photos = |run: &Value| run["footprint"].is_object();
    if !runs.iter().any(|(_, run)| of_photos(run)) {
        return;
    }
    let mut put = |text: std::fmt::Arguments<'_>| put(page, text);
    put(format_args!(
        "\n| answerable photos | with a fix | right (within 5 % of the footprint) | 95 % interval, by place | wrong, of all photos | neither right nor wrong |\n|---|---:|---:|---:|---:|---:|\n"
    ));
    for (name, run) in runs.iter().filter(|(_, run)| of_photos(run)) {
        let shares = &run["footprint"];
        put(format_args!(
            "| {}: {} | {} | {} | {} to {}, {} places | {} | {} |\n",
            name.replace('_', " "),
            shares["answerable"],
            shares["answerable_fixes"],
            shares["right"],
            percent(shares["right_share_interval"][0].as_f64()),
            percent(shares["right_share_interval"][1].as_f64()),
            shares["places"],
            shares["wrong"],
            shares["undecided"],
        ));
    }
}

/// How often fixes of a stated confidence are right.
fn reliability(page: &mut String, runs: &[(&String, &Value)]) {
    let mut rows = String::new();
    for (name, run) in runs {
        for bin in run["reliability"]["bins"].as_array().into_iter().flatten() {
            put(
                &mut rows,
                format_args!(
                    "| {} | {} to {} | {} | {} | {} | {} to {} |\n",
                    name.replace('_', " "),
                    percent(bin["from"].as_f64()),
                    percent(bin["to"].as_f64()),
                    bin["fixes"],
                    percent(bin["mean_confidence"].as_f64()),
                    bin["right"],
                    percent(bin["right_share_interval"][0].as_f64()),
                    percent(bin["right_share_interval"][1].as_f64()),
                ),
            );
        }
    }
    if !rows.is_empty() {
        put(
            page,
            format_args!(
                "\n| | stated confidence | fixes | mean | right | 95 % interval |\n|---|---|---:|---:|---:|---:|\n{rows}"
            ),
        );
    }
}

/// The runs of a summary: everything but `about`.
fn runs(summary: &Value) -> Vec<(&String, &Value)> {
    summary
        .as_object()
        .into_iter()
        .flatten()
        .filter(|(name, _)| *name != "about")
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn worse_figures_are_called_behind_and_better_ones_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let claim = folder.path().join("a");
        fs_err::create_dir_all(&claim).unwrap();
        let peer = |name: &str, within_5m, median_m| Peer {
            name: name.into(),
            run: "heading_known".into(),
            within_5m,
            within_10m: 0.9,
            within_20m: 0.9,
            median_m,
            source: "measured elsewhere".into(),
        };
        let text = serde_json::to_string(&Claim {
            title: "A".into(),
            data: "b".into(),
            command: "c".into(),
            peers: vec![peer("Worse", 0.5, 9.0), peer("Better", 0.95, 1.04)],
            remarks: vec![],
        })
        .unwrap();
        fs_err::write(claim.join("claim.json"), text).unwrap();
        let summary = r#"{"about":{"mode":"default"},"heading_known":{"frames":10,"fixes":9,"within_5m":0.9,
            "within_10m":0.9,"within_20m":0.9,"median_m":1.01,
            "footprint":{"answerable":8,"answerable_fixes":7,"right":6,"right_share_interval":[0.4,0.9],"places":3,
                "wrong":1,"undecided":0},
            "reliability":{"bins":[{"from":0.9,"to":0.97,"fixes":7,"mean_confidence":0.95,"right":6,
                "right_share_interval":[0.5,0.99]}]}}}"#;
        fs_err::write(claim.join("summary.json"), summary).unwrap();
        let page = page(folder.path()).unwrap();
        assert!(page.contains("behind Better (within 5 m) |"), "{page}");
        assert!(!page.contains("behind Worse"), "{page}");
        assert!(page.contains("| 9 of 10 |"), "{page}");
        let shares = "| heading known: 8 | 7 | 6 | 40 % to 90 %, 3 places | 1 | 0 |";
        assert!(page.contains(shares), "{page}");
        let bin = "| heading known | 90 % to 97 % | 7 | 95 % | 6 | 50 % to 99 % |";
        assert!(page.contains(bin), "{page}");
        fs_err::write(claim.join("summary.json"), "{").unwrap();
        let error = super::page(folder.path()).unwrap_err().to_string();
        assert!(error.contains("summary.json"), "{error}");
    }
}
