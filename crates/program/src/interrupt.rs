//! Ctrl-C and SIGTERM during work whose results so far are to be kept.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use signal_hook::consts::{SIGINT, SIGTERM};

/// The first Ctrl-C or SIGTERM sets `stop`, the second one ends the program at once with status 130.
///
/// # Errors
/// The system refuses to tell signals.
pub fn stop_on_interrupt(stop: &Arc<AtomicBool>) -> std::io::Result<()> {
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 130, stop.clone())?;
        signal_hook::flag::register(signal, stop.clone())?;
    }
    Ok(())
}
