//! Sweeps as one self-contained HTML page: a plot and a table each.

use maud::{Markup, html};
use plotters::prelude::*;

use crate::experiment_table::{ExperimentTable, Row};
use grimnet_eval::report::html;
use grimnet_eval::report::plot::{PlotError, draw_key, name_in_key, svg_chart};

const SIZE_PX: (u32, u32) = (760, 280);

/// The page; it refers to nothing outside itself.
///
/// # Errors
/// A plot cannot be drawn.
pub fn page(title: &str, tables: &[ExperimentTable]) -> Result<String, PlotError> {
    let plots = tables
        .iter()
        .map(|table| Ok((table, shares_plots(table)?)))
        .collect::<Result<Vec<_>, PlotError>>()?;
    let content = html! {
        @for (table, plots) in plots {
            h2 { (table.title) }
            @for (case, plot) in plots {
                @if !case.is_empty() { h3 { (case) } }
                (html::svg(plot))
            }
            (html_table(table))
            @for note in &table.notes { p { (note) } }
        }
    };
    Ok(html::page(title, &content))
}

/// A plot for each case of a table: rows are named `value, case`, or `value` where there is one case only.
fn shares_plots(table: &ExperimentTable) -> Result<Vec<(&str, String)>, PlotError> {
    let mut cases: Vec<(&str, Vec<(&str, &Row)>)> = Vec::new();
    for row in &table.rows {
        let (value, case) = row.name.split_once(", ").unwrap_or((&row.name, ""));
        match cases.iter_mut().find(|(known, _)| *known == case) {
            Some((_, rows)) => rows.push((value, row)),
            None => cases.push((case, vec![(value, row)])),
        }
    }
    cases
        .into_iter()
        .map(|(case, rows)| Ok((case, shares_plot(table, &rows)?)))
        .collect()
}

/// Every column of percent as a line over the rows, which have names for the axis.
fn shares_plot(table: &ExperimentTable, rows: &[(&str, &Row)]) -> Result<String, PlotError> {
    let last = rows.len().saturating_sub(1).max(1) as f64;
    svg_chart(SIZE_PX, 30, (-0.3..last + 0.3, 0.0..105.0), |chart| {
        let name = |x: &f64| {
            let i = x.round();
            let is_row = (x - i).abs() < 1e-6 && i >= 0.0;
            let row = is_row.then(|| rows.get(i as usize)).flatten();
            row.map_or_else(String::new, |(name, _)| (*name).to_owned())
        };
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .x_labels(2 * rows.len().max(1))
            .x_label_formatter(&name)
            .y_desc("% of frames")
            .draw()?;
        let shares = table
            .columns
            .iter()
            .enumerate()
            .filter(|(_, c)| c.unit == "%");
        for (i, (column, head)) in shares.enumerate() {
            let colour = Palette99::pick(i).to_rgba();
            let points: Vec<(f64, f64)> = rows
                .iter()
                .enumerate()
                .filter_map(|(x, (_, row))| Some((x as f64, (*row.values.get(column)?)?)))
                .collect();
            let line = LineSeries::new(points.clone(), colour.stroke_width(2));
            name_in_key(chart.draw_series(line)?, &head.name, colour);
            chart.draw_series(
                points
                    .into_iter()
                    .map(|at| Circle::new(at, 3, colour.filled())),
            )?;
        }
        draw_key(chart, SeriesLabelPosition::LowerLeft)
    })
}

fn html_table(table: &ExperimentTable) -> Markup {
    html! {
        table {
            tr { th {} @for column in &table.columns { th { (column.head()) } } }
            @for row in &table.rows {
                tr {
                    td { (row.name) }
                    @for (column, value) in table.columns.iter().zip(&row.values) {
                        td { (column.print(*value)) }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment_table::Column;

    #[test]
    fn each_case_has_a_plot_of_its_own() {
        let row = |name: &str| Row::new(name, vec![Some(90.0)]);
        let table = ExperimentTable {
            columns: vec![Column::percent("within 5 m")],
            rows: vec![
                row("0.5, reported"),
                row("0.5, reported as 1"),
                row("2, reported"),
                row("2, reported as 1"),
            ],
            ..ExperimentTable::default()
        };
        let plots = shares_plots(&table).unwrap();
        let cases: Vec<&str> = plots.iter().map(|(case, _)| *case).collect();
        assert_eq!(cases, ["reported", "reported as 1"]);
        // Two points each.
        for (case, plot) in &plots {
            assert_eq!(plot.matches("<circle").count(), 2, "{case}");
        }
    }

    #[test]
    fn the_page_plots_and_shows_every_table() {
        let table = ExperimentTable {
            title: "Blur <px>".into(),
            columns: vec![Column::percent("within 5 m"), Column::metres("median")],
            rows: vec![
                Row::new("0", vec![Some(100.0), Some(0.4)]),
                Row::new("8", vec![Some(37.5), None]),
            ],
            ..ExperimentTable::default()
        };
        let page = page("Robustness", &[table]).unwrap();
        for part in [
            "Blur &lt;px&gt;",
            "<svg",
            "within 5 m",
            "<td>37.5</td>",
            "<td>-</td>",
        ] {
            assert!(page.contains(part), "{part}");
        }
    }
}
