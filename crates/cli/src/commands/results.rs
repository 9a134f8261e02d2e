//! Prints the figures of evaluated runs.

use std::io::Write;

use anyhow::Result;
use grimnet_answer::printable;
use grimnet_eval::metrics::footprint::FootprintSummary;
use grimnet_eval::metrics::recall::RECALL_AT;
use grimnet_eval::report::{Run, counted};
use grimnet_eval::retrieval::RetrievalSummary;
use grimnet_output::OutputFolder;

use crate::standard_output::StandardOutput;

/// Width of the column of names, and of each run's column.
const NAME_WIDTH: usize = 36;
const RUN_WIDTH: usize = 24;

/// The K at which SDM@K and PDM@K are printed.
const DISTANCE_AT: [usize; 3] = [1, 5, 10];

/// A row: its name, and its cell for a run.
type Row = (&'static str, fn(&Run) -> String);

fn percent(share: f64) -> String {
    format!("{:.0} %", share * 100.0)
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"))
}

const ROWS: [Row; 16] = [
    ("", |r| r.name.clone()),
    ("photos", |r| r.summary.frames.to_string()),
    ("fixes", |r| r.summary.fixes.to_string()),
    ("within 5 m", |r| percent(r.summary.within_5m)),
    ("within 10 m", |r| percent(r.summary.within_10m)),
    ("within 20 m", |r| percent(r.summary.within_20m)),
    ("median error (a miss is infinite)", |r| {
        metres(r.summary.median_m)
    }),
    ("mean error of the fixes (ALE)", |r| metres(r.summary.ale_m)),
    ("mean error east, north", |r| {
        let (east, north) = (r.summary.bias_east_m, r.summary.bias_north_m);
        east.zip(north)
            .map_or_else(|| "-".to_owned(), |(e, n)| format!("{e:+.1}, {n:+.1} m"))
    }),
    ("median distance from GPS", |r| {
        metres(r.summary.gps_median_m)
    }),
    ("median stated 95 % radius", |r| {
        metres(r.summary.radius95_median_m)
    }),
    ("within stated 50/90/95 % radius, %", |r| {
        let s = &r.summary;
        [s.coverage_50, s.coverage_90, s.coverage_95]
            .map(|share| share.map_or_else(|| "-".to_owned(), |v| format!("{:.0}", v * 100.0)))
            .join("/")
    }),
    ("within 95 % radius + truth's error", |r| {
        r.summary
            .coverage_95_with_truth_error
            .map_or_else(|| "-".to_owned(), percent)
    }),
    ("error above 3 stated sigma", |r| {
        r.summary.beyond_3_sigma.to_string()
    }),
    ("confidently wrong", |r| {
        r.summary.confidently_wrong.to_string()
    }),
    ("median time per photo", |r| {
        r.summary
            .time_p50_ms
            .map_or_else(|| "-".to_owned(), |t| format!("{t:.0} ms"))
    }),
];

/// A row about errors as shares of the footprint: its name, and its cell for a run.
type FootprintRow = (&'static str, fn(&FootprintSummary) -> String);

/// Rows for photos whose ground width is known.
const FOOTPRINT_ROWS: [FootprintRow; 7] = [
    ("answerable photos", |s| s.answerable.to_string()),
    ("answerable photos with a fix", |s| {
        s.answerable_fixes.to_string()
    }),
    ("right (within 5 % of footprint)", |s| {
        format!("{} ({})", s.right, percent(s.right_share))
    }),
    ("95 % interval by place", |s| {
        let [low, high] = s.right_share_interval.map(|v| 100.0 * v);
        format!("{low:.0}-{high:.0} %, {}", counted(s.places, "place"))
    }),
    ("wrong (any photo)", |s| s.wrong.to_string()),
    ("neither right nor wrong", |s| s.undecided.to_string()),
    ("median error / footprint", |s| {
        s.median_share
            .map_or_else(|| "-".to_owned(), |v| format!("{:.2} %", 100.0 * v))
    }),
];

/// Prints the figures, one column per run.
///
/// # Errors
/// Standard output is closed.
pub fn print_summary(runs: &[Run]) -> Result<()> {
    for (name, cell) in ROWS {
        line(name, runs.iter().map(cell))?;
    }
    let footprints: Vec<_> = runs
        .iter()
        .map(|run| FootprintSummary::of(&run.frames))
        .collect();
    if footprints.iter().any(Option::is_some) {
        writeln!(StandardOutput)?;
        for (name, cell) in FOOTPRINT_ROWS {
            let cells = footprints
                .iter()
                .map(|summary| summary.as_ref().map_or_else(|| "-".to_owned(), cell));
            line(name, cells)?;
        }
    }
    Ok(())
}

/// Prints retrieval figures, one column per run.
///
/// # Errors
/// Standard output is closed.
pub fn print_retrieval(runs: &[RetrievalSummary]) -> Result<()> {
    let Some(first) = runs.first() else {
        return Ok(());
    };
    writeln!(
        StandardOutput,
        "\nrecall among {} (a tile is right if it covers the true centre)",
        counted(first.gallery_tiles, "tile")
    )?;
    let row = |name: &str, cell: &dyn Fn(&RetrievalSummary) -> f64| {
        line(name, runs.iter().map(|run| percent(cell(run))))
    };
    // Paper mode takes five tiles: recall among more is not known.
    let retrieved = runs.iter().map(|run| run.retrieved).max().unwrap_or(0);
    let ranks = || {
        let all = RECALL_AT.iter().enumerate();
        all.filter(|&(i, &k)| i == 0 || k <= retrieved)
    };
    for (i, k) in ranks() {
        row(&format!("R@{k} by descriptor"), &|r| {
            r.covers.by_descriptor[i]
        })?;
    }
    // The same without an index of the keypoints: on maps of few tiles.
    if runs
        .iter()
        .any(|run| run.covers.by_search != run.covers.by_descriptor)
    {
        for (i, k) in ranks() {
            row(&format!("R@{k} with map votes"), &|r| r.covers.by_search[i])?;
        }
    }
    // The same in paper mode, which has no vote, and where the vote changes no rank.
    if runs
        .iter()
        .any(|run| run.covers.by_vote != run.covers.by_search)
    {
        for (i, k) in ranks() {
            row(&format!("R@{k} after the vote"), &|r| r.covers.by_vote[i])?;
        }
    }
    row("a right tile was matched", &|r| r.covers.matched)?;
    let index = |k: usize| RECALL_AT.iter().position(|&at| at == k).unwrap_or(0);
    for k in DISTANCE_AT.into_iter().filter(|&k| k <= retrieved) {
        row(&format!("SDM@{k} by descriptor"), &|r| {
            r.distance.sdm_by_descriptor[index(k)]
        })?;
        row(&format!("PDM@{k} by descriptor"), &|r| {
            r.distance.pdm_by_descriptor[index(k)]
        })?;
    }
    let radius = first.radius_px;
    row(&format!("R@5, centre within {radius:.0} px"), &|r| {
        r.near.by_descriptor[index(5)]
    })
}

/// Says where the page of the results is, which is among `files` in `folder`.
///
/// # Errors
/// Standard output is closed.
pub fn print_report_path(folder: &OutputFolder, files: &[&str]) -> Result<()> {
    if let Some(page) = files.iter().find(|name| name.ends_with(".html")) {
        let path = folder.path().join(page).display().to_string();
        writeln!(StandardOutput, "\nThe report is {}", printable(&path))?;
    }
    Ok(())
}

fn line(name: &str, cells: impl Iterator<Item = String>) -> Result<()> {
    let mut out = StandardOutput;
    write!(out, "{name:<NAME_WIDTH$}")?;
    for cell in cells {
        write!(out, "{cell:>RUN_WIDTH$}")?;
    }
    Ok(writeln!(out)?)
}
