//! A claim's section of EVALUATION.md.

use std::fmt::Write as _;

use serde_json::Value;

use crate::claim::{Claim, Peer};

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

/// What `grim eval` measured.
pub(crate) struct Figures {
    /// `summary.json`.
    pub summary: Value,
    /// `recall.json`, if the ranks of the right tile are shown.
    pub recall: Option<Value>,
    /// `elsewhere.json`, if photos that are not on the map were tried.
    pub elsewhere: Option<Value>,
}

/// Adds a claim: its conditions, the comparison with peers, and the other figures.
pub(crate) fn section(page: &mut String, claim: &Claim, figures: &Figures) {
    let summary = &figures.summary;
    conditions(page, claim, &summary["about"]);
    let runs = runs(summary);
    comparison(page, claim, &runs);
    other_figures(page, &runs);
    footprint_shares(page, &runs);
    reliability(page, &runs);
    if let Some(ranks) = &figures.recall {
        recall(page, ranks);
    }
    if let Some(tried) = &figures.elsewhere {
        elsewhere(page, tried);
    }
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
        "`{}`\n\nMode {}, model {} ({}){}, program {} at commit {}, map error in the radii {} m, error of the truth {}.\n\n",
        claim.command,
        text("mode"),
        text("model_hash"),
        if about["model_calibrated"] == true {
            "calibrated"
        } else {
            "not calibrated"
        },
        about["precision"]
            .as_str()
            .map(|precision| format!(" in {precision}"))
            .unwrap_or_default(),
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
            "| {}: {} | {} | {} | {} to {}, {} | {} | {} |\n",
            name.replace('_', " "),
            shares["answerable"],
            shares["answerable_fixes"],
            shares["right"],
            percent(shares["right_share_interval"][0].as_f64()),
            percent(shares["right_share_interval"][1].as_f64()),
            counted(&shares["places"], "place"),
            shares["wrong"],
            shares["undecided"],
        ));
    }
}

/// A stored number with its noun.
fn counted(number: &Value, noun: &str) -> String {
    grimnet_eval::report::counted(number.as_u64().unwrap_or(0) as usize, noun)
}

/// How often fixes of a stated confidence are right.
fn reliability(page: &mut String, runs: &[(&String, &Value)]) {
    let mut rows = String::new();
    for (name, run) in runs {
        for bin in run["reliability"]["bins"].as_array().into_iter().flatten() {
            put(
                &mut rows,
                format_args!(
                    "| {} | {} to {} | {} | {} | {} | {} to {}, {} |\n",
                    name.replace('_', " "),
                    percent(bin["from"].as_f64()),
                    percent(bin["to"].as_f64()),
                    bin["fixes"],
                    percent(bin["mean_confidence"].as_f64()),
                    bin["right"],
                    percent(bin["right_share_interval"][0].as_f64()),
                    percent(bin["right_share_interval"][1].as_f64()),
                    counted(&bin["places"], "place"),
                ),
            );
        }
    }
    if !rows.is_empty() {
        put(
            page,
            format_args!(
                "\n| | stated confidence | fixes | mean | right | 95 % interval, by place |\n|---|---|---:|---:|---:|---:|\n{rows}"
            ),
        );
    }
}

/// Shares of photos with a tile that covers their centre among the first, from `recall.json`.
fn recall(page: &mut String, runs: &Value) {
    let runs = runs.as_array().map_or(&[][..], Vec::as_slice);
    let numbers = |values: &Value| values.as_array().cloned().unwrap_or_default();
    let Some(first) = runs.first() else { return };
    let at = numbers(&first["covers"]["at"]);
    put(page, format_args!("\n| a right tile is among the first |"));
    for k in &at {
        put(page, format_args!(" {k} |"));
    }
    put(
        page,
        format_args!(" was matched |\n|---|{}---:|\n", "---:|".repeat(at.len())),
    );
    for run in runs {
        let covers = &run["covers"];
        for (key, how) in [
            ("by_descriptor", "by descriptor"),
            ("by_search", "by descriptor and map votes"),
            ("by_vote", "after the vote"),
        ] {
            // Maps of few tiles are not voted over as a whole.
            let is_other = key != "by_search" || covers[key] != covers["by_descriptor"];
            if covers[key].is_null() || !is_other {
                continue;
            }
            let name = run["run"].as_str().unwrap_or("-");
            let tiles = &run["gallery_tiles"];
            put(page, format_args!("| {name}, {tiles} tiles, {how} |"));
            for share in numbers(&covers[key]).iter().chain([&covers["matched"]]) {
                put(page, format_args!(" {} |", percent(share.as_f64())));
            }
            put(page, format_args!("\n"));
        }
    }
}

/// Photos that are not on the map, by group, from `elsewhere.json`.
fn elsewhere(page: &mut String, summary: &Value) {
    let groups = ["by_training", "by_setting", "by_source"];
    let groups = groups.iter().filter_map(|&key| summary[key].as_array());
    put(
        page,
        format_args!(
            "\n| photos that are not on the map | trials | fixes | 95 % interval, by picture |\n|---|---:|---:|---:|\n"
        ),
    );
    for group in std::iter::once(&summary["all"]).chain(groups.flatten()) {
        let limit =
            |index: usize| 100.0 * group["share_interval"][index].as_f64().unwrap_or(f64::NAN);
        put(
            page,
            format_args!(
                "| {} | {} | {} | {:.2} % to {:.2} %, {} |\n",
                group["name"].as_str().unwrap_or("-"),
                group["trials"],
                group["fixes"],
                limit(0),
                limit(1),
                counted(&group["pictures"], "picture"),
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
