//! Training curves: a CSV file with a row for each report, and a plot of it as SVG.

use crate::error::TrainError;
use crate::run::losses::Losses;
use crate::run::report::Progress;
use crate::run::run_folder::{CURVES, CURVES_PLOT, RunFolder};
use crate::run::step_table::StepTable;
use std::fmt::Write as _;

/// Columns before and after the losses.
const BEFORE: [&str; 2] = ["step", "elapsed_s"];
const AFTER: [&str; 3] = ["pairs_per_s", "learning_rate", "gradient"];
/// Colours of the losses.
const COLOURS: [&str; 8] = [
    "#c33", "#36c", "#393", "#939", "#e90", "#099", "#666", "#630",
];
/// Size of the plot, pixels.
const SIZE_PX: [f64; 2] = [900.0, 420.0];
/// Space for the tick labels.
const MARGIN_PX: f64 = 50.0;
/// Most points of a curve; more rows are averaged.
const POINTS: usize = 300;

/// The reports of a run.
#[derive(Debug)]
pub struct Curves {
    folder: RunFolder,
    table: StepTable,
    columns: Vec<String>,
    /// The values of the table, for the plot; not a number where a loss was not computed.
    rows: Vec<Vec<f64>>,
}

/// Names of the losses as columns.
fn loss_columns() -> impl Iterator<Item = String> {
    let names = Losses::default().terms().map(|(name, _)| name);
    names
        .into_iter()
        .map(|name| name.trim_end_matches(" loss").replace(' ', "_"))
}

impl Curves {
    /// The curves in `folder`, for a run that starts or resumes at `step`; see [`StepTable::open`] for which rows are kept.
    ///
    /// # Errors
    /// As [`StepTable::open`].
    pub fn open(folder: &RunFolder, step: u64) -> Result<Self, TrainError> {
        let before = BEFORE.map(str::to_owned).into_iter();
        let columns: Vec<String> = before
            .chain(loss_columns())
            .chain(AFTER.map(str::to_owned))
            .collect();
        let table = StepTable::open(folder, CURVES, &columns.join(","), step)?;
        let values = |row: &String| -> Option<Vec<f64>> {
            let value = |text: &str| match text {
                "" => Some(f64::NAN),
                number => number.parse().ok(),
            };
            row.split(',').map(value).collect()
        };
        Ok(Self {
            rows: table.rows().iter().filter_map(values).collect(),
            folder: folder.clone(),
            table,
            columns,
        })
    }

    /// Adds a report and rewrites both files.
    ///
    /// # Errors
    /// [`TrainError::Output`] if the files cannot be written.
    pub fn add(&mut self, p: &Progress) -> Result<(), TrainError> {
        let losses = p
            .losses
            .terms()
            .map(|(_, value)| value.map_or(f64::NAN, f64::from));
        let before = [p.step as f64, p.elapsed_s];
        let after = [p.pairs_per_s, p.learning_rate, f64::from(p.gradient)];
        let row = [&before[..], &losses, &after].concat();
        // The digits of single precision, as many as the value has: a small learning rate is not 0.
        let text = |value: &f64| match value.is_nan() {
            true => String::new(),
            false => (*value as f32).to_string(),
        };
        let values: Vec<String> = row.iter().map(text).collect();
        self.table.add([values.join(",")])?;
        self.rows.push(row);
        self.folder.write(CURVES_PLOT, self.svg().as_bytes())
    }

    /// The losses over the steps; losses that were never computed, or are always 0, are not drawn.
    fn svg(&self) -> String {
        let [width, height] = SIZE_PX;
        let inner = [width - 2.0 * MARGIN_PX, height - 2.0 * MARGIN_PX];
        let last = self.rows.last().map_or(1.0, |r| r[0]).max(1.0);
        let drawn: Vec<usize> = (BEFORE.len()..self.columns.len() - AFTER.len())
            .filter(|column| self.rows.iter().any(|row| row[*column].abs() > 0.0))
            .collect();
        let top = self
            .rows
            .iter()
            .flat_map(|row| drawn.iter().map(|column| row[*column]))
            .fold(1e-6f64, f64::max);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" font-family=\"sans-serif\" font-size=\"12\">\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
        );
        for i in 0..=4 {
            let share = f64::from(i) / 4.0;
            let y = MARGIN_PX + inner[1] * (1.0 - share);
            let x = MARGIN_PX + inner[0] * share;
            let _ = write!(
                out,
                "<path d=\"M{MARGIN_PX} {y}h{}\" stroke=\"#ddd\"/><text x=\"8\" y=\"{y}\">{:.2}</text>\
                 <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{:.0}</text>",
                inner[0],
                top * share,
                height - MARGIN_PX + 18.0,
                last * share
            );
        }
        for (k, column) in drawn.into_iter().enumerate() {
            let colour = COLOURS[k % COLOURS.len()];
            let _ = write!(
                out,
                "<polyline fill=\"none\" stroke=\"{colour}\" points=\"{}\"/>\
                 <text x=\"{}\" y=\"24\" fill=\"{colour}\">{}</text>",
                self.points(column, inner, [last, top]),
                MARGIN_PX + 110.0 * k as f64,
                self.columns[column]
            );
        }
        out.push_str("</svg>\n");
        out
    }

    /// A column as points of a polyline.
    fn points(&self, column: usize, inner: [f64; 2], [last, top]: [f64; 2]) -> String {
        let points: Vec<String> = self
            .rows
            .chunks(self.rows.len().div_ceil(POINTS).max(1))
            .filter_map(|rows| {
                let mean = |i: usize| {
                    let values = || rows.iter().map(|r| r[i]).filter(|v| !v.is_nan());
                    let count = values().count();
                    (count > 0).then(|| values().sum::<f64>() / count as f64)
                };
                let x = MARGIN_PX + inner[0] * mean(0)? / last;
                let y = MARGIN_PX + inner[1] * (1.0 - mean(column)? / top);
                Some(format!("{x:.1},{y:.1}"))
            })
            .collect();
        points.join(" ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrainConfig;
    use grimnet_output::OutputPolicy;

    fn progress(step: u64) -> Progress {
        Progress {
            step,
            elapsed_s: step as f64,
            remaining_s: 0.0,
            losses: Losses {
                keypoint: Some(2.0),
                descriptor: Some(1.0 / step as f32),
                // By turns.
                global: (step == 100).then_some(0.5),
                ..Losses::default()
            },
            pairs_per_s: 3.0,
            learning_rate: 2e-8,
            gradient: 0.5,
        }
    }

    #[test]
    fn a_resumed_run_goes_on_where_its_checkpoint_was() {
        let folder = tempfile::tempdir().unwrap();
        let config = TrainConfig {
            out: folder.path().to_owned(),
            ..TrainConfig::default()
        };
        let run = RunFolder::open(&config, &OutputPolicy::new()).unwrap();
        let mut first = Curves::open(&run, 0).unwrap();
        for step in [50, 100, 150] {
            first.add(&progress(step)).unwrap();
        }
        let mut second = Curves::open(&run, 100).unwrap();
        second.add(&progress(160)).unwrap();
        let text = fs_err::read_to_string(folder.path().join("curves.csv")).unwrap();
        let steps: Vec<&str> = text
            .lines()
            .skip(1)
            .map(|l| l.split(',').next().unwrap())
            .collect();
        assert_eq!(steps, ["50", "100", "160"]);
        assert!(text.ends_with(",3,0.00000002,0.5\n"), "{text}");
        let svg = fs_err::read_to_string(folder.path().join("curves.svg")).unwrap();
        assert_eq!(svg.matches("<polyline").count(), 3);
        assert!(!svg.contains("NaN"));
    }
}
