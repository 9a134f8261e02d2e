//! Ctrl-C and SIGTERM during work whose results so far are to be kept.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};

const NOTICED_WITHIN: Duration = Duration::from_millis(50);

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

/// The first Ctrl-C or SIGTERM ends the program with status 130 after `say`: for work that any end leaves such that it can go on.
///
/// # Errors
/// The system refuses to tell signals, or a thread.
pub fn end_on_interrupt(say: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    let stop = Arc::default();
    stop_on_interrupt(&stop)?;
    std::thread::Builder::new()
        .name("interrupt".to_owned())
        .spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                std::thread::sleep(NOTICED_WITHIN);
            }
            say();
            std::process::exit(130);
        })?;
    Ok(())
}
