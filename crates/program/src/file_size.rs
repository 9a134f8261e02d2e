//! The limit on the size of files (`ulimit -f`).

/// Lets a write beyond the limit fail with an error, as on a full disk. The system would end the program without a word
/// (SIGXFSZ).
///
/// # Errors
/// The system refuses to set what a signal does.
#[cfg(unix)]
pub fn report_limit_as_error() -> std::io::Result<()> {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    // Any handler does: the write returns EFBIG after it. Child processes begin without it.
    let nobody_asks = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, nobody_asks)?;
    Ok(())
}

/// There is no such signal on this system.
///
/// # Errors
/// Never.
#[cfg(not(unix))]
pub fn report_limit_as_error() -> std::io::Result<()> {
    Ok(())
}
