//! Curves as SVG.

use std::ops::Range;

use plotters::chart::SeriesAnno;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use crate::metrics::reliability::Reliability;
use crate::metrics::{Frame, risk_coverage};

/// A curve could not be drawn.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw a curve: {0}")]
pub struct PlotError(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for PlotError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        Self(error.to_string())
    }
}

/// Size of every curve.
const SIZE_PX: (u32, u32) = (900, 320);

/// Largest error that distributions show, and above which a photo's error is red, metres.
pub(super) const AXIS_M: f64 = 30.0;

/// Least top of an axis that reaches to the largest error, metres.
const LEAST_AXIS_M: f64 = 5.0;

/// Least top of the axis of failures, percent.
const RISK_AXIS_PERCENT: f64 = 20.0;

/// A chart with linear axes.
pub type Chart<'s> = ChartContext<'s, SVGBackend<'s>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Ranges and labels of the axes.
pub(crate) struct Axes {
    pub x: Range<f64>,
    pub y: Range<f64>,
    pub x_desc: &'static str,
    pub y_desc: &'static str,
}

/// An SVG picture of `size_px`; `draw` fills the chart; `below_px` is the height of the labels below the horizontal axis.
pub fn svg_chart(
    size_px: (u32, u32),
    below_px: u32,
    (x, y): (Range<f64>, Range<f64>),
    draw: impl FnOnce(&mut Chart<'_>) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, size_px).into_drawing_area();
        let mut chart = ChartBuilder::on(&root)
            .margin(10)
            // Half of the last label of the horizontal axis.
            .margin_right(24)
            .x_label_area_size(below_px)
            .y_label_area_size(48)
            .build_cartesian_2d(x, y)?;
        draw(&mut chart)?;
        root.present()?;
    }
    Ok(svg)
}

/// A chart of the usual size with labelled axes.
pub(crate) fn curves(
    axes: Axes,
    draw: impl FnOnce(&mut Chart<'_>) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    svg_chart(SIZE_PX, 36, (axes.x, axes.y), |chart| {
        chart
            .configure_mesh()
            .x_desc(axes.x_desc)
            .y_desc(axes.y_desc)
            .draw()?;
        draw(chart)
    })
}

/// Adds a series to the legend.
pub fn name_in_key<'c>(series: &mut SeriesAnno<'c, SVGBackend<'_>>, name: &str, colour: RGBAColor) {
    series
        .label(name)
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour));
}

/// Draws the legend of all named series.
pub fn draw_key(chart: &mut Chart<'_>, position: SeriesLabelPosition) -> Result<(), PlotError> {
    chart
        .configure_series_labels()
        .position(position)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    Ok(())
}

/// Share of all photos within a distance, for several runs (cumulative distribution of the error).
///
/// # Errors
/// Drawing fails.
pub fn error_distribution(runs: &[(&str, &[Frame])]) -> Result<String, PlotError> {
    let axes = Axes {
        x: 0.0..AXIS_M,
        y: 0.0..100.0,
        x_desc: "error, m",
        y_desc: "% of photos",
    };
    curves(axes, |chart| {
        for (i, (name, frames)) in runs.iter().enumerate() {
            let colour = Palette99::pick(i).to_rgba();
            let mut errors: Vec<f64> = frames.iter().filter_map(|f| f.error_m).collect();
            errors.sort_by(f64::total_cmp);
            let step = 100.0 / frames.len().max(1) as f64;
            let mut points = vec![(0.0, 0.0)];
            for (k, error) in errors.iter().enumerate().take_while(|(_, e)| **e <= AXIS_M) {
                points.push((*error, k as f64 * step));
                points.push((*error, (k + 1) as f64 * step));
            }
            let height = points.last().map_or(0.0, |p| p.1);
            points.push((AXIS_M, height));
            let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            name_in_key(series, name, colour);
        }
        draw_key(chart, SeriesLabelPosition::LowerRight)
    })
}

/// Top of an axis of errors that shows every error of the frames, at least [`LEAST_AXIS_M`], metres.
fn axis_for<'a>(frames: impl Iterator<Item = &'a Frame>) -> f64 {
    let largest = frames.filter_map(|frame| frame.error_m);
    (1.05 * largest.fold(0.0, f64::max)).max(LEAST_AXIS_M)
}

/// Error of each photo in the order of flight, with its stated 95 % radius (figure 7a of the paper). The axis reaches to the largest
/// error; a radius beyond it is cut off.
///
/// # Errors
/// Drawing fails.
pub fn error_per_frame(frames: &[Frame]) -> Result<String, PlotError> {
    let axis_m = axis_for(frames.iter());
    let axes = Axes {
        x: 0.0..frames.len().max(1) as f64,
        y: 0.0..axis_m,
        x_desc: "photo",
        y_desc: "error, m",
    };
    curves(axes, |chart| {
        for (i, frame) in frames.iter().enumerate() {
            let (Some(error), x) = (frame.error_m, i as f64 + 0.5) else {
                continue;
            };
            if let Some(radius) = frame.radius95_m {
                let top = radius.min(axis_m);
                chart.draw_series([Rectangle::new(
                    [(x - 0.4, 0.0), (x + 0.4, top)],
                    BLUE.mix(0.15).filled(),
                )])?;
            }
            let colour = if error > AXIS_M { RED } else { BLUE };
            chart.draw_series([Circle::new((x, error), 3, colour.filled())])?;
        }
        Ok(())
    })
}

/// Share of failures among the most confident answers over their share of all photos (risk-coverage curve). The axis reaches to the
/// largest share, and to 20 % at least.
///
/// # Errors
/// Drawing fails.
pub fn risk_coverage(runs: &[(&str, &[Frame])]) -> Result<String, PlotError> {
    let percent = |share: f64| 100.0 * share;
    let points = runs.iter().map(|(_, frames)| risk_coverage::curve(frames));
    let points: Vec<Vec<risk_coverage::Point>> = points.collect();
    let risks = points.iter().flatten().map(|point| percent(point.risk));
    let axes = Axes {
        x: 0.0..100.0,
        y: 0.0..risks.fold(RISK_AXIS_PERCENT, f64::max),
        x_desc: "% of photos with a fix, most confident first",
        y_desc: "% of these with an error above 20 m",
    };
    curves(axes, |chart| {
        for (i, ((name, _), points)) in runs.iter().zip(points).enumerate() {
            let colour = Palette99::pick(i).to_rgba();
            let points = points
                .into_iter()
                .map(|point| (percent(point.coverage), percent(point.risk)));
            let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            name_in_key(series, name, colour);
        }
        draw_key(chart, SeriesLabelPosition::UpperLeft)
    })
}

/// Share of right fixes over the stated confidence, with 95 % intervals, beside the diagonal of a perfect calibration (reliability
/// diagram).
///
/// # Errors
/// Drawing fails.
pub fn reliability(runs: &[(&str, Reliability)]) -> Result<String, PlotError> {
    let axes = Axes {
        x: 0.0..100.0,
        y: 0.0..102.0,
        x_desc: "stated confidence, %",
        y_desc: "% of these fixes that are right",
    };
    curves(axes, |chart| {
        let diagonal = [(0.0, 0.0), (100.0, 100.0)];
        chart.draw_series(LineSeries::new(diagonal, BLACK.mix(0.3)))?;
        for (i, (name, reliability)) in runs.iter().enumerate() {
            let colour = Palette99::pick(i).to_rgba();
            let points: Vec<(f64, f64)> = reliability
                .bins
                .iter()
                .map(|bin| (100.0 * bin.mean_confidence, 100.0 * bin.right_share))
                .collect();
            let intervals = reliability.bins.iter().map(|bin| {
                let x = 100.0 * bin.mean_confidence;
                let ends = bin.right_share_interval.map(|end| (x, 100.0 * end));
                PathElement::new(ends.to_vec(), colour.mix(0.5))
            });
            chart.draw_series(intervals)?;
            let series = LineSeries::new(points, colour.stroke_width(2)).point_size(3);
            name_in_key(chart.draw_series(series)?, name, colour);
        }
        draw_key(chart, SeriesLabelPosition::LowerRight)
    })
}

/// Error of each photo, one line per run (figure 7b of the paper). A miss interrupts the line; the axis reaches to the largest error.
///
/// # Errors
/// Drawing fails.
pub fn runs_compared(runs: &[(&str, &[Frame])]) -> Result<String, PlotError> {
    let longest = runs
        .iter()
        .map(|(_, frames)| frames.len())
        .max()
        .unwrap_or(0);
    let axes = Axes {
        x: 0.0..longest.max(1) as f64,
        y: 0.0..axis_for(runs.iter().flat_map(|(_, frames)| frames.iter())),
        x_desc: "photo",
        y_desc: "error, m",
    };
    curves(axes, |chart| {
        for (i, (name, frames)) in runs.iter().enumerate() {
            let colour = Palette99::pick(i).to_rgba();
            let errors: Vec<Option<f64>> = frames.iter().map(|f| f.error_m).collect();
            let mut start = 0;
            for part in errors.split(Option::is_none) {
                let points = part
                    .iter()
                    .flatten()
                    .enumerate()
                    .map(|(k, error)| ((start + k) as f64 + 0.5, *error));
                chart.draw_series(LineSeries::new(points, colour.stroke_width(1)).point_size(2))?;
                start += part.len() + 1;
            }
            let series = chart.draw_series(LineSeries::new([(0.0, -1.0)], colour))?;
            name_in_key(series, name, colour);
        }
        draw_key(chart, SeriesLabelPosition::UpperRight)
    })
}
