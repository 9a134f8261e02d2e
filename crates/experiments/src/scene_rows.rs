//! Common parts of the tables over several scenes: one column per scene, one row per setup, and the paper's figures.

use crate::bench::{Bench, BenchError, Measured, Setup};
use crate::experiment_table::{Column, ExperimentTable, Row};
use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::scene::Scene;

/// The paper's scenes.
pub(super) const PAPER_SCENES: [&str; 5] = [
    "Metropolitan University",
    "Energy Center",
    "Business School",
    "Holy Name Church",
    "Museum",
];

/// Errors in the paper's scenes, metres, by row.
pub(super) type PaperRow = (&'static str, [f64; 5]);

/// The paper's table 4.
pub(super) const PAPER_MODULES: [PaperRow; 4] = [
    ("G + S", [70.56, 98.33, 69.23, 43.97, 67.19]),
    ("G + M", [38.15, 33.45, 99.12, 87.53, 81.67]),
    ("M + L", [6.37, 12.91, 14.53, 40.08, 33.78]),
    ("G + M + L", [4.33, 11.84, 13.96, 29.62, 13.85]),
];

/// The paper's table 10.
pub(super) const PAPER_DA_BN: [PaperRow; 2] = [
    ("GRiM-Net", [4.33, 11.84, 13.96, 29.62, 13.85]),
    ("without DA-BN", [6.59, 16.75, 19.21, 38.48, 19.23]),
];

/// Measurements on each scene with the setup for it.
pub(super) fn over(
    bench: &mut Bench<'_>,
    scenes: &[Scene],
    setup: impl Fn(&Scene) -> Result<Setup, BenchError>,
) -> Result<Vec<Measured>, BenchError> {
    scenes
        .iter()
        .map(|scene| bench.measure(scene, &setup(scene)?))
        .collect()
}

pub(super) fn all_frames(measured: &[Measured]) -> Vec<Frame> {
    measured
        .iter()
        .flat_map(|m| m.frames.iter().cloned())
        .collect()
}

/// Mean of the values that are known; `None` if there are none.
pub(super) fn mean(values: &[Option<f64>]) -> Option<f64> {
    let there: Vec<f64> = values.iter().flatten().copied().collect();
    (!there.is_empty()).then(|| there.iter().sum::<f64>() / there.len() as f64)
}

pub(super) fn ale(measured: &Measured) -> Option<f64> {
    Summary::of(&measured.frames).ale_m
}

pub(super) fn mean_time_s(frames: &[Frame]) -> Option<f64> {
    mean(
        &frames
            .iter()
            .map(|f| f.time_ms.map(|t| t / 1e3))
            .collect::<Vec<_>>(),
    )
}

/// One column per scene, the average over scenes, and the shares of all photos.
fn scene_columns(scenes: &[Scene]) -> Vec<Column> {
    let mut columns: Vec<Column> = scenes.iter().map(|s| Column::metres(&*s.name)).collect();
    columns.extend([
        Column::metres("average"),
        Column::percent("with a fix"),
        Column::percent("within 20 m"),
        Column::seconds("time per frame"),
    ]);
    columns
}

/// A row for [`scene_columns`].
pub(super) fn scene_row(name: &str, measured: &[Measured]) -> Row {
    let mut values: Vec<Option<f64>> = measured.iter().map(ale).collect();
    let average = mean(&values);
    let frames = all_frames(measured);
    let summary = Summary::of(&frames);
    values.extend([
        average,
        Some(100.0 * summary.fixes as f64 / summary.frames.max(1) as f64),
        Some(100.0 * summary.within_20m),
        mean_time_s(&frames),
    ]);
    Row::new(name, values)
}

/// Columns and rows of the paper's errors by scene.
pub(super) fn paper_scenes(rows: &[PaperRow]) -> (Vec<Column>, Vec<Row>) {
    let rows = rows
        .iter()
        .map(|(name, values)| Row::new(*name, values.map(Some).to_vec()));
    (PAPER_SCENES.map(Column::metres).to_vec(), rows.collect())
}

/// The note of every table of errors.
pub(super) const ALE_NOTE: &str = "Metres are average errors over the frames with a fix (ALE); a frame without one has no error, and is counted in the columns of shares.";

/// The note of tables with rows of different inputs.
pub(super) const INPUTS_NOTE: &str = "The rows of the paper's procedure without other words are given nothing but the pixels, as published, and default mode with nothing given has as little; the other rows of both are given heading and ground width. Compare rows of equal inputs.";

/// A table of errors by scene without rows.
pub(super) fn table(id: &str, title: &str, number: u32, scenes: &[Scene]) -> ExperimentTable {
    ExperimentTable {
        id: id.to_owned(),
        title: title.to_owned(),
        paper_table: Some(number),
        columns: scene_columns(scenes),
        notes: vec![ALE_NOTE.to_owned()],
        ..ExperimentTable::default()
    }
}
