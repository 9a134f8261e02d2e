//! Curves of a track: errors over time beside the stated radius, their distribution, and the path on the ground.

use grimnet_geo::offset_en_m;
use grimnet_track::measure::Instant;
use plotters::prelude::*;

use super::ground_cover::CoveredLeg;
use super::rendered::RenderedFlight;
use crate::report::plot::{Axes, PlotError, curves, draw_key, name_in_key, svg_chart};

/// Largest error that the curves show, metres.
const AXIS_M: f64 = 30.0;
/// Side of the picture of a path.
const PATH_PX: (u32, u32) = (640, 640);

/// Share of instants within a distance, for several runs.
///
/// # Errors
/// Drawing fails.
pub fn error_distribution(runs: &[(&str, Vec<&Instant>)]) -> Result<String, PlotError> {
    let axes = Axes {
        x: 0.0..AXIS_M,
        y: 0.0..100.0,
        x_desc: "error, m",
        y_desc: "% of instants",
    };
    curves(axes, |chart| {
        for (index, (name, instants)) in runs.iter().enumerate() {
            let colour = Palette99::pick(index).to_rgba();
            let mut errors: Vec<f64> = instants
                .iter()
                .filter_map(|instant| instant.answer.map(|answer| answer.error_m()))
                .collect();
            errors.sort_by(f64::total_cmp);
            let all = instants.len().max(1) as f64;
            // A point for each tenth of a metre, however many instants there are.
            let points = (0..=300).map(|tenth| {
                let limit_m = f64::from(tenth) / 10.0;
                let within = errors.partition_point(|error| *error <= limit_m);
                (limit_m, 100.0 * within as f64 / all)
            });
            let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            name_in_key(series, name, colour);
        }
        draw_key(chart, SeriesLabelPosition::LowerRight)
    })
}

/// Error over time with the stated 95 % radius; legs over water and snow are shaded.
///
/// # Errors
/// Drawing fails.
pub fn error_over_time(instants: &[Instant], legs: &[CoveredLeg]) -> Result<String, PlotError> {
    let end_s = instants.last().map_or(1.0, |last| last.time_s);
    let axes = Axes {
        x: 0.0..end_s,
        y: 0.0..AXIS_M,
        x_desc: "time, s",
        y_desc: "error and stated radius, m",
    };
    curves(axes, |chart| {
        for leg in legs {
            let corners = [(leg.from_s, 0.0), (leg.to_s.min(end_s), AXIS_M)];
            chart.draw_series([Rectangle::new(corners, CYAN.mix(0.15).filled())])?;
        }
        let line = |value: fn(&grimnet_track::measure::Answer) -> f64| {
            instants
                .split(|instant| instant.answer.is_none())
                .map(|part| {
                    part.iter()
                        .filter_map(|i| Some((i.time_s, value(&i.answer?).min(AXIS_M))))
                        .collect::<Vec<_>>()
                })
                .collect::<Vec<_>>()
        };
        let series = [
            ("stated 95 % radius", line(|a| a.radius95_m), BLUE.mix(0.5)),
            ("error", line(|a| a.error_m()), RED.to_rgba()),
        ];
        for (name, parts, colour) in series {
            for part in parts {
                chart.draw_series(LineSeries::new(part, colour.stroke_width(1)))?;
            }
            let empty = chart.draw_series(LineSeries::new([(0.0, -1.0)], colour))?;
            name_in_key(empty, name, colour);
        }
        draw_key(chart, SeriesLabelPosition::UpperRight)
    })
}

/// True path, track and fixes, metres east and north of the start.
///
/// # Errors
/// Drawing fails.
pub fn path(flight: &RenderedFlight, track: &[Instant]) -> Result<String, PlotError> {
    let start = flight.flight.truth_at(0.0);
    let place = |time_s: f64| offset_en_m(start, flight.flight.truth_at(time_s));
    let truth: Vec<(f64, f64)> = track.iter().map(|instant| place(instant.time_s)).collect();
    let reach_m = truth
        .iter()
        .fold(50.0, |most: f64, (e, n)| most.max(e.abs()).max(n.abs()))
        * 1.1;
    svg_chart(
        PATH_PX,
        36,
        (-reach_m..reach_m, -reach_m..reach_m),
        |chart| {
            chart
                .configure_mesh()
                .x_desc("east, m")
                .y_desc("north, m")
                .draw()?;
            let truth_colour = BLACK.mix(0.4);
            let series =
                chart.draw_series(LineSeries::new(truth.clone(), truth_colour.stroke_width(3)))?;
            name_in_key(series, "truth", truth_colour);
            let colour = RED.to_rgba();
            let answers = track.iter().zip(&truth).filter_map(|(instant, truth)| {
                let [east_m, north_m] = instant.answer?.error_en_m;
                Some((truth.0 + east_m, truth.1 + north_m))
            });
            let points = answers.map(|at| Circle::new(at, 1, colour.filled()));
            chart.draw_series(points)?;
            let empty = chart.draw_series(LineSeries::new([(0.0, 10.0 * reach_m)], colour))?;
            name_in_key(empty, "track", colour);
            draw_key(chart, SeriesLabelPosition::UpperRight)
        },
    )
}
