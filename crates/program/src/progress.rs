//! Progress of long work: a bar on a terminal; where standard error is a pipe or a file, a line a minute for whoever asks with `-v`.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use tracing::Level;

/// Time between two lines.
const BETWEEN_LINES: Duration = Duration::from_secs(60);

/// A bar that counts to `total`, with rate and time left.
pub fn bar(total: u64, what: &str, unit: &str) -> ProgressBar {
    let bar = ProgressBar::new(total);
    let template = format!(
        "{what:<22} {{wide_bar}} {{pos}}/{{len}} {unit}, {{per_sec}}, {{eta}} left {{msg}}"
    );
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.progress_chars("━╸ "));
    }
    if !bar.is_hidden() {
        bar.enable_steady_tick(Duration::from_millis(250));
    } else if tracing::enabled!(Level::INFO) {
        log_lines(&bar, what, unit);
    }
    bar
}

/// Moves a bar to where an earlier run ended: what that did says nothing about the rate of this one, nor about the time left.
pub fn go_on_from(bar: &ProgressBar, done: u64, total: u64) {
    bar.set_position(done);
    // Second: this one passes the position on to the estimate, also where the bar ticks by itself.
    bar.set_length(total);
    bar.reset_eta();
}

/// A spinner, for work whose steps are not counted.
pub fn spinner(what: &str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(what.to_owned());
    spinner.enable_steady_tick(Duration::from_millis(250));
    spinner
}

/// Logs where the bar stands from time to time, until it is finished or gone.
fn log_lines(bar: &ProgressBar, what: &str, unit: &str) {
    let (bar, what, unit) = (bar.downgrade(), what.to_owned(), unit.to_owned());
    let lines = move || {
        loop {
            std::thread::sleep(BETWEEN_LINES);
            match bar.upgrade() {
                Some(bar) if !bar.is_finished() => tracing::info!("{}", line(&bar, &what, &unit)),
                _ => return,
            }
        }
    };
    // Without a thread there are no lines, and the work goes on.
    let _ = std::thread::Builder::new()
        .name("progress".into())
        .spawn(lines);
}

fn line(bar: &ProgressBar, what: &str, unit: &str) -> String {
    let (done, total) = (bar.position(), bar.length().unwrap_or(0));
    let left_min = bar.eta().as_secs_f64() / 60.0;
    format!("{what}: {done} of {total} {unit}, about {left_min:.0} min left")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_much_is_done() {
        let bar = ProgressBar::hidden();
        bar.set_length(847);
        bar.inc(120);
        let line = line(&bar, "localising", "photos");
        assert!(line.starts_with("localising: 120 of 847 photos, about "));
    }

    #[test]
    fn what_an_earlier_run_did_counts_for_no_rate() {
        let bar = ProgressBar::hidden();
        // As on a terminal.
        bar.enable_steady_tick(Duration::from_secs(3600));
        go_on_from(&bar, 1000, 2000);
        std::thread::sleep(Duration::from_millis(5));
        // What the next tick does.
        bar.set_length(2000);
        assert_eq!(bar.position(), 1000);
        assert!(bar.per_sec() < 1.0, "{} per second", bar.per_sec());
    }
}
