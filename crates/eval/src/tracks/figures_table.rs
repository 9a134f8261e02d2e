//! The figures of runs as the rows of a table.

use maud::{Markup, html};

use super::figures::{RunFigures, ThreeFigures};

/// A value with its unit; a dash if it is not known.
pub(super) fn number(value: Option<f64>, unit: &str) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} {unit}"))
}

/// A share in percent; a dash if it is not known.
pub(super) fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |v| format!("{:.1} %", 100.0 * v))
}

/// A row: its name, and its cell for a run.
type Row = (&'static str, fn(&RunFigures) -> String);

/// The figures of a run, for tables.
pub const ROWS: [Row; 16] = [
    ("answered", |r| percent(Some(r.track.answered))),
    ("median error", |r| number(r.track.median_m, "m")),
    ("90th percentile", |r| number(r.track.p90_m, "m")),
    ("99th percentile", |r| number(r.track.p99_m, "m")),
    ("stated radius below 5 m", |r| {
        percent(Some(r.track.availability_5m))
    }),
    ("stated radius below 10 m", |r| {
        percent(Some(r.track.availability_10m))
    }),
    ("stated radius below 25 m", |r| {
        percent(Some(r.track.availability_25m))
    }),
    ("longest gap", |r| number(Some(r.track.longest_gap_s), "s")),
    ("first fix after", |r| number(r.first_fix_s, "s")),
    ("relocalised after", |r| number(r.relocalise_s, "s")),
    ("relocalised after, frames", |r| {
        number(r.relocalise_frames, "")
    }),
    ("not relocalised, flights", |r| {
        r.not_relocalised.to_string()
    }),
    ("confidently wrong instants", |r| {
        r.track.confidently_wrong.to_string()
    }),
    ("95 % ellipse holds", |r| percent(r.track.ellipse95_holds)),
    ("mean NEES (2 expected)", |r| number(r.track.mean_nees, "")),
    ("mean NIS (2 expected)", |r| {
        number(r.nis.map(|nis| nis.mean), "")
    }),
];

/// The three runs beside each other.
pub(super) fn figures_table(figures: &ThreeFigures) -> Markup {
    html! {
        table {
            tr {
                th { (format!("{} flights, {:.2} h", figures.flights, figures.hours)) }
                @for (name, _) in figures.runs() { th { (name) } }
            }
            @for (name, cell) in ROWS {
                tr {
                    td { (name) }
                    @for (_, run) in figures.runs() { td { (cell(run)) } }
                }
            }
        }
    }
}
