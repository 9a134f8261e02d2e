//! What a run of `grim eval` leaves behind: tables, files, a page.

use std::io::Write;

use anyhow::Result;
use grimnet_eval::report::{Picture, Report, Run};
use grimnet_output::OutputFolder;
use serde::Serialize;

/// Under which conditions the figures were measured; `about` in `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct About {
    /// What was localised.
    pub data: String,
    /// `default` or `paper`.
    pub mode: String,
    /// Identity of the model.
    pub model_hash: String,
    /// Whether the model's radii were fitted (`grim calibrate`).
    pub model_calibrated: bool,
    /// Commit that the program was built from, where it was told.
    pub commit: Option<String>,
    /// Version of the program.
    pub version: &'static str,
    /// Error of the map that the stated radii include, metres (1 sigma per axis).
    pub map_error_m: f64,
    /// Error of the truth, metres (1 sigma per axis), where it was told.
    pub truth_error_m: Option<f64>,
    /// Ground width of the photos, metres, where it was told.
    pub footprint_width_m: Option<f64>,
    /// Size of the pack over the map's area.
    pub pack_bytes_per_km2: f64,
    /// Most memory that the program held, MiB; none where the system does not tell.
    pub peak_memory_mib: Option<f64>,
}

impl About {
    fn lines(&self) -> Vec<String> {
        let of =
            |value: Option<f64>| value.map_or_else(|| "not told".to_owned(), |v| format!("{v} m"));
        vec![
            format!(
                "Mode {}; model {} ({}); program {} at commit {}.",
                self.mode,
                &self.model_hash[..self.model_hash.len().min(16)],
                if self.model_calibrated {
                    "calibrated"
                } else {
                    "radii by built-in default, never fitted"
                },
                self.version,
                self.commit.as_deref().unwrap_or("not told"),
            ),
            format!(
                "Stated radii include a map error of {} m per axis (1 sigma). Error of the truth: {}. Ground width of the photos: {}.",
                self.map_error_m,
                of(self.truth_error_m),
                of(self.footprint_width_m)
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

/// Most memory that this process held so far, MiB (Linux).
pub fn peak_memory_mib() -> Option<f64> {
    let status = fs_err::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

/// Writes `summary.json`, `frames.csv`, `failed.jsonl` and `report.html`.
///
/// # Errors
/// One of them cannot be written.
pub fn write_results(
    folder: &OutputFolder,
    title: String,
    about: &About,
    runs: &[Run],
    pictures: Vec<Picture>,
) -> Result<()> {
    let about_json = serde_json::to_value(about)?;
    write_figures(folder, Some(about_json), runs)?;
    let mut frames = csv::Writer::from_writer(Vec::new());
    frames.write_record([
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
    ])?;
    let mut failed = String::new();
    for run in runs {
        for frame in &run.frames {
            let number = |v: Option<f64>| v.map(|v| format!("{v:.3}")).unwrap_or_default();
            frames.write_record([
                run.name.clone(),
                frame.photo.clone(),
                if frame.fixed { "fix" } else { "no_fix" }.to_owned(),
                number(frame.error_m),
                number(frame.error_east_m),
                number(frame.error_north_m),
                number(frame.radius95_m),
                frame.reason.clone().unwrap_or_default(),
                number(frame.time_ms),
                frame
                    .confidence
                    .map(|v| format!("{v:.6}"))
                    .unwrap_or_default(),
                frame.inliers.map(|v| v.to_string()).unwrap_or_default(),
                number(frame.gps_error_m),
            ])?;
            if !frame.fixed {
                let line = serde_json::json!({ "run": run.name, "photo": frame.photo, "reason": frame.reason });
                failed.push_str(&format!("{line}\n"));
            }
        }
    }
    folder.write_bytes("frames.csv", &frames.into_inner()?)?;
    folder.write_bytes("failed.jsonl", failed.as_bytes())?;
    let report = Report {
        title,
        description: about.lines(),
        runs: runs.to_vec(),
        pictures,
    };
    folder.write_bytes("report.html", report.to_html()?.as_bytes())?;
    Ok(())
}

/// Writes the figures of each run to `summary.json`, under its name with underscores, such as `heading_known`.
///
/// # Errors
/// The file cannot be written.
pub fn write_summary(folder: &OutputFolder, runs: &[Run]) -> Result<()> {
    write_figures(folder, None, runs)
}

fn write_figures(
    folder: &OutputFolder,
    about: Option<serde_json::Value>,
    runs: &[Run],
) -> Result<()> {
    let mut summary = serde_json::Map::new();
    if let Some(about) = about {
        summary.insert("about".to_owned(), about);
    }
    for run in runs {
        summary.insert(
            run.name.replace(' ', "_"),
            serde_json::to_value(&run.summary)?,
        );
    }
    let text = serde_json::to_string_pretty(&summary)?;
    folder.write_bytes("summary.json", (text + "\n").as_bytes())?;
    Ok(())
}

/// Prints the figures, a column a run.
///
/// # Errors
/// Standard output is gone.
pub fn print_summary(runs: &[Run]) -> Result<()> {
    type Cell = fn(&Run) -> String;
    fn percent(share: f64) -> String {
        format!("{:.0} %", share * 100.0)
    }
    fn metres(value: Option<f64>) -> String {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"))
    }
    let rows: [(&str, Cell); 16] = [
        ("", |r| r.name.clone()),
        ("frames", |r| r.summary.frames.to_string()),
        ("with a fix", |r| r.summary.fixes.to_string()),
        ("within 5 m", |r| percent(r.summary.within_5m)),
        ("within 10 m", |r| percent(r.summary.within_10m)),
        ("within 20 m", |r| percent(r.summary.within_20m)),
        ("median (a miss is infinite)", |r| {
            metres(r.summary.median_m)
        }),
        ("average of the fixes (ALE)", |r| metres(r.summary.ale_m)),
        ("bias east, north", |r| {
            let (east, north) = (r.summary.bias_east_m, r.summary.bias_north_m);
            east.zip(north)
                .map_or_else(|| "-".to_owned(), |(e, n)| format!("{e:+.1}, {n:+.1} m"))
        }),
        ("median from the GPS point", |r| {
            metres(r.summary.gps_median_m)
        }),
        ("median stated 95 % radius", |r| {
            metres(r.summary.radius95_median_m)
        }),
        ("within stated 50/90/95 %", |r| {
            let s = &r.summary;
            [s.coverage_50, s.coverage_90, s.coverage_95]
                .map(|share| share.map_or_else(|| "-".to_owned(), |v| format!("{:.0}", v * 100.0)))
                .join("/")
        }),
        ("same, truth's error in (95)", |r| {
            r.summary
                .coverage_95_with_truth_error
                .map_or_else(|| "-".to_owned(), percent)
        }),
        ("beyond 3 stated sigma", |r| {
            r.summary.beyond_3_sigma.to_string()
        }),
        ("confidently wrong", |r| {
            r.summary.confidently_wrong.to_string()
        }),
        ("median time a photo", |r| {
            r.summary
                .time_p50_ms
                .map_or_else(|| "-".to_owned(), |t| format!("{t:.0} ms"))
        }),
    ];
    let mut out = std::io::stdout().lock();
    for (name, cell) in rows {
        write!(out, "{name:<28}")?;
        for run in runs {
            write!(out, "{:>20}", cell(run))?;
        }
        writeln!(out)?;
    }
    Ok(())
}
