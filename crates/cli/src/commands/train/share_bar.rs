//! A progress bar over a share of work.

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};

/// A progress bar in thousandths of the work.
pub(super) fn share_bar() -> Result<ProgressBar> {
    let bar = ProgressBar::new(1000);
    bar.set_style(
        ProgressStyle::with_template("{wide_bar} {percent:>3} % {msg}")?.progress_chars("━╸ "),
    );
    Ok(bar)
}
