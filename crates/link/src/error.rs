//! Errors.

use std::{io, path::PathBuf};

/// Why something could not be opened or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The file with the key for signing is not usable.
    #[error("{path}: not a signing key: {reason}", path = path.display())]
    SigningKey {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A thread cannot be started.
    #[error("cannot start a thread for {what}: {source}")]
    Thread {
        /// What it is for.
        what: String,
        /// Why.
        source: io::Error,
    },
    /// No autopilot was heard.
    #[error(
        "no autopilot was heard on {address} within {within_s:.0} s{reason}; check that it is powered, the port and its baud \
         rate, and that the port speaks MAVLink 2"
    )]
    NoAutopilot {
        /// Where it was awaited.
        address: String,
        /// For how long, seconds.
        within_s: f64,
        /// What else is known, beginning with a separator.
        reason: String,
    },
    /// A telemetry file is not usable.
    #[error("{path}: {reason}", path = path.display())]
    Telemetry {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what was expected.
        reason: String,
    },
}
