//! Options of commands that talk with an autopilot.

use std::path::PathBuf;

use anyhow::Result;
use grimnet_link::{Address, Output, SigningKey};

use crate::inputs;

/// How the autopilot is reached, and what carries positions.
#[derive(Debug, Clone, clap::Args)]
pub struct LinkChoice {
    /// Message that carries positions: odometry, global-position-sensor, position-estimate, gps-input [default: odometry;
    /// global-position-sensor for PX4 1.18 and later]
    #[arg(long, value_name = "MESSAGE")]
    pub mavlink_message: Option<Output>,

    /// MAVLink system of the autopilot [default: the first one heard]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..))]
    pub mavlink_system: Option<u8>,

    /// File with the key for signed messages: 64 hexadecimal digits or a passphrase, in one line
    #[arg(long, value_name = "FILE")]
    pub mavlink_key: Option<PathBuf>,
}

impl LinkChoice {
    /// The key, if there is one.
    ///
    /// # Errors
    /// A file that cannot be read or holds no key.
    pub fn key(&self) -> Result<Option<SigningKey>> {
        let Some(path) = &self.mavlink_key else {
            return Ok(None);
        };
        inputs::check_regular(path)?;
        Ok(Some(SigningKey::from_file(path)?))
    }
}

/// An address of the command line.
///
/// # Errors
/// What was expected.
pub fn address(text: &str) -> Result<Address, String> {
    text.parse()
        .map_err(|error: grimnet_link::AddressError| error.to_string())
}
