//! How a run went: a CSV file that grows with every report, and the same as SVG.

use crate::TrainError;
use crate::trainer::Progress;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Columns of the CSV file; those from the third to the fifth are drawn.
const HEADER: &str = "step,elapsed_s,keypoint,descriptor,global,pairs_per_s,learning_rate,gradient";
/// Size of the picture, pixels.
const SIZE_PX: [f64; 2] = [900.0, 420.0];
/// Space for the axes' numbers.
const MARGIN_PX: f64 = 50.0;
/// Points drawn a curve; more are averaged.
const POINTS: usize = 300;

/// The reports of a run.
#[derive(Debug)]
pub struct Curves {
    path: PathBuf,
    rows: Vec<[f64; 8]>,
}

impl Curves {
    /// Curves in `folder`; those of earlier runs up to `step` are read back, what came after it is forgotten.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn open(folder: &Path, step: u64) -> Result<Self, TrainError> {
        let path = folder.join("curves.csv");
        let mut rows = Vec::new();
        if step > 0 && path.exists() {
            for line in fs_err::read_to_string(&path)?.lines().skip(1) {
                let values: Vec<f64> = line.split(',').filter_map(|v| v.parse().ok()).collect();
                // A line that a crash cut short is left out.
                if let Ok(row) = <[f64; 8]>::try_from(values)
                    && row[0] <= step as f64
                {
                    rows.push(row);
                }
            }
        }
        Ok(Self { path, rows })
    }

    /// Adds a report and writes both files anew.
    ///
    /// # Errors
    /// A folder that cannot be written to.
    pub fn add(&mut self, p: &Progress) -> Result<(), TrainError> {
        self.rows.push([
            p.step as f64,
            p.elapsed_s,
            f64::from(p.losses.keypoint),
            f64::from(p.losses.descriptor),
            f64::from(p.losses.global),
            p.pairs_per_s,
            p.learning_rate,
            f64::from(p.gradient),
        ]);
        let mut text = format!("{HEADER}\n");
        for r in &self.rows {
            let line = r.map(|v| format!("{v:.6}")).join(",");
            text.push_str(&line);
            text.push('\n');
        }
        if let Some(folder) = self.path.parent() {
            fs_err::create_dir_all(folder)?;
        }
        fs_err::write(&self.path, text)?;
        fs_err::write(self.path.with_extension("svg"), self.svg())?;
        Ok(())
    }

    /// The losses over the steps; values of some reports are averaged where there are many.
    fn svg(&self) -> String {
        let [width, height] = SIZE_PX;
        let (inner_w, inner_h) = (width - 2.0 * MARGIN_PX, height - 2.0 * MARGIN_PX);
        let last = self.rows.last().map_or(1.0, |r| r[0]).max(1.0);
        let top = self
            .rows
            .iter()
            .flat_map(|r| &r[2..5])
            .fold(0.0f64, |a, b| a.max(*b))
            .max(1e-6);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" font-family=\"sans-serif\" font-size=\"12\">\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
        );
        for i in 0..=4 {
            let share = f64::from(i) / 4.0;
            let y = MARGIN_PX + inner_h * (1.0 - share);
            let x = MARGIN_PX + inner_w * share;
            let _ = write!(
                out,
                "<path d=\"M{MARGIN_PX} {y}h{inner_w}\" stroke=\"#ddd\"/><text x=\"8\" y=\"{y}\">{:.2}</text>\
                 <text x=\"{x}\" y=\"{}\" text-anchor=\"middle\">{:.0}</text>",
                top * share,
                height - MARGIN_PX + 18.0,
                last * share
            );
        }
        let curves = [
            ("keypoint", "#c33"),
            ("descriptor", "#36c"),
            ("global", "#393"),
        ];
        for (k, (name, colour)) in curves.into_iter().enumerate() {
            let points: Vec<String> = self
                .rows
                .chunks(self.rows.len().div_ceil(POINTS).max(1))
                .map(|rows| {
                    let mean =
                        |i: usize| rows.iter().map(|r| r[i]).sum::<f64>() / rows.len() as f64;
                    let x = MARGIN_PX + inner_w * mean(0) / last;
                    let y = MARGIN_PX + inner_h * (1.0 - mean(2 + k) / top);
                    format!("{x:.1},{y:.1}")
                })
                .collect();
            let _ = write!(
                out,
                "<polyline fill=\"none\" stroke=\"{colour}\" points=\"{}\"/>\
                 <text x=\"{}\" y=\"24\" fill=\"{colour}\">{name}</text>",
                points.join(" "),
                MARGIN_PX + 110.0 * k as f64
            );
        }
        out.push_str("</svg>\n");
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Losses;

    fn progress(step: u64) -> Progress {
        Progress {
            step,
            elapsed_s: step as f64,
            remaining_s: 0.0,
            losses: Losses {
                keypoint: 2.0,
                descriptor: 1.0 / step as f32,
                ..Losses::default()
            },
            pairs_per_s: 3.0,
            learning_rate: 1e-3,
            gradient: 0.5,
        }
    }

    #[test]
    fn a_resumed_run_goes_on_where_its_checkpoint_was() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = Curves::open(folder.path(), 0).unwrap();
        for step in [50, 100, 150] {
            first.add(&progress(step)).unwrap();
        }
        let mut second = Curves::open(folder.path(), 100).unwrap();
        second.add(&progress(160)).unwrap();
        let text = fs_err::read_to_string(folder.path().join("curves.csv")).unwrap();
        let steps: Vec<&str> = text
            .lines()
            .skip(1)
            .map(|l| l.split('.').next().unwrap())
            .collect();
        assert_eq!(steps, ["50", "100", "160"]);
        let svg = fs_err::read_to_string(folder.path().join("curves.svg")).unwrap();
        assert_eq!(svg.matches("<polyline").count(), 3);
    }
}
