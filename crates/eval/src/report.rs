//! One self-contained HTML page that shows a run: figures, curves, the map with answers, match pictures.

use std::fmt::Write as _;

use base64::Engine as _;

use crate::html::{escape, page_head};
use crate::metrics::{Frame, Summary};
use crate::plot;

/// One way in which the same frames were answered, such as "heading known".
#[derive(Debug, Clone)]
pub struct Run {
    /// What it is called.
    pub name: String,
    /// Its frames, in flight order.
    pub frames: Vec<Frame>,
    /// Their figures.
    pub summary: Summary,
}

/// A picture on the page.
#[derive(Debug, Clone)]
pub struct Picture {
    /// What it shows.
    pub caption: String,
    /// JPEG bytes.
    pub jpeg: Vec<u8>,
}

/// What the page shows.
#[derive(Debug, Clone)]
pub struct Report {
    /// Its title.
    pub title: String,
    /// A line or two on what was measured: map, model, mode.
    pub description: Vec<String>,
    /// The runs, side by side.
    pub runs: Vec<Run>,
    /// Pictures, most telling first.
    pub pictures: Vec<Picture>,
}

impl Report {
    /// The page as HTML; it refers to nothing outside itself.
    ///
    /// # Errors
    /// A curve cannot be drawn.
    pub fn to_html(&self) -> Result<String, plot::PlotError> {
        let mut page = page_head(&self.title);
        for line in &self.description {
            push(&mut page, format_args!("<p>{}</p>", escape(line)));
        }
        page.push_str(&figures_table(&self.runs));
        let curves: Vec<(&str, &[Frame])> = self
            .runs
            .iter()
            .map(|r| (r.name.as_str(), r.frames.as_slice()))
            .collect();
        figure(
            &mut page,
            &plot::error_distribution(&curves)?,
            "Share of all frames within a distance",
        );
        figure(
            &mut page,
            &plot::risk_coverage(&curves)?,
            "How often the surest answers are wrong",
        );
        figure(
            &mut page,
            &plot::runs_compared(&curves)?,
            "Error of each frame, all runs (a gap is a frame without a fix)",
        );
        for run in &self.runs {
            let caption = format!(
                "{}: error of each frame (a gap is a frame without a fix)",
                run.name
            );
            figure(&mut page, &plot::error_per_frame(&run.frames)?, &caption);
        }
        for picture in &self.pictures {
            let data = base64::engine::general_purpose::STANDARD.encode(&picture.jpeg);
            let caption = escape(&picture.caption);
            figure(
                &mut page,
                &format!("<img alt=\"{caption}\" src=\"data:image/jpeg;base64,{data}\">"),
                &picture.caption,
            );
        }
        for run in &self.runs {
            page.push_str(&frames_table(run));
        }
        Ok(page)
    }
}

fn push(page: &mut String, text: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = page.write_fmt(text);
}

fn figure(page: &mut String, content: &str, caption: &str) {
    push(
        page,
        format_args!(
            "<figure>{content}<figcaption>{}</figcaption></figure>",
            escape(caption)
        ),
    );
}

fn figures_table(runs: &[Run]) -> String {
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let metres = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"));
    type Figure = (&'static str, fn(&Summary) -> f64);
    let shares: [Figure; 4] = [
        ("within 5 m", |s| s.within_5m),
        ("within 10 m", |s| s.within_10m),
        ("within 20 m", |s| s.within_20m),
        ("within 25 m", |s| s.within_25m),
    ];
    let mut table = String::from("<table><tr><th></th>");
    for run in runs {
        push(&mut table, format_args!("<th>{}</th>", escape(&run.name)));
    }
    let mut row = |name: &str, cell: &dyn Fn(&Summary) -> String| {
        push(&mut table, format_args!("</tr><tr><td>{name}</td>"));
        for run in runs {
            push(&mut table, format_args!("<td>{}</td>", cell(&run.summary)));
        }
    };
    row("frames", &|s| s.frames.to_string());
    row("fixes", &|s| s.fixes.to_string());
    for (name, share) in shares {
        row(name, &|s| percent(share(s)));
    }
    row("median, a miss counted as infinite", &|s| {
        metres(s.median_m)
    });
    row("90th percentile", &|s| metres(s.p90_m));
    row("average error of the fixes", &|s| metres(s.ale_m));
    row("bias east", &|s| metres(s.bias_east_m));
    row("bias north", &|s| metres(s.bias_north_m));
    row("confidently wrong", &|s| s.confidently_wrong.to_string());
    row("beyond 3 stated standard deviations", &|s| {
        s.beyond_3_sigma.to_string()
    });
    let share = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), percent);
    row("truth within the stated 50 % radius", &|s| {
        share(s.coverage_50)
    });
    row("truth within the stated 90 % radius", &|s| {
        share(s.coverage_90)
    });
    row("truth within the stated 95 % radius", &|s| {
        share(s.coverage_95)
    });
    row("the same, the truth's own error counted in", &|s| {
        share(s.coverage_95_with_truth_error)
    });
    row("median of the stated 95 % radius", &|s| {
        metres(s.radius95_median_m)
    });
    row("median distance from the GPS point", &|s| {
        metres(s.gps_median_m)
    });
    row("risk-coverage area", &|s| {
        s.risk_coverage_area
            .map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"))
    });
    row("median time a frame", &|s| {
        s.time_p50_ms
            .map_or_else(|| "-".to_owned(), |t| format!("{t:.0} ms"))
    });
    table.push_str("</tr></table>");
    table
}

fn frames_table(run: &Run) -> String {
    let mut table = format!(
        "<details><summary>{}: every frame</summary><table><tr><th>photo</th><th>error</th><th>stated 95 %</th><th>ms</th></tr>",
        escape(&run.name)
    );
    for frame in &run.frames {
        let number = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v:.1}"));
        let error = match (&frame.reason, frame.error_m) {
            (_, Some(error)) => format!("{error:.1} m"),
            (reason, None) => format!(
                "<span class=miss>{}</span>",
                escape(reason.as_deref().unwrap_or("no fix"))
            ),
        };
        push(
            &mut table,
            format_args!(
                "<tr><td>{}</td><td>{error}</td><td>{}</td><td>{}</td></tr>",
                escape(&frame.photo),
                number(frame.radius95_m),
                number(frame.time_ms)
            ),
        );
    }
    table.push_str("</table></details>");
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_holds_everything_and_escapes_names() {
        let frames = vec![
            Frame {
                photo: "<a>.jpg".into(),
                fixed: true,
                error_m: Some(2.0),
                ..Frame::default()
            },
            Frame::missed("b.jpg", "too dark & blurred"),
        ];
        let summary = Summary::of(&frames);
        let page = Report {
            title: "A flight".into(),
            description: vec!["over nowhere".into()],
            runs: vec![Run {
                name: "heading known".into(),
                frames,
                summary,
            }],
            pictures: vec![Picture {
                caption: "map".into(),
                jpeg: vec![1, 2, 3],
            }],
        }
        .to_html()
        .unwrap();
        for part in [
            "&lt;a&gt;.jpg",
            "too dark &amp; blurred",
            "data:image/jpeg;base64,AQID",
            "<svg",
            "50 %",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("<a>.jpg"));
    }
}
