//! Options of a link to an autopilot.

use crate::{
    address::Address, output::Output, signing::SigningKey, telemetry::mavlink::TelemetryOptions,
};

/// Positions with a 95 % radius above this are not for an autopilot, metres.
pub const MAX_RADIUS95_M: f64 = 150.0;

/// How a link to an autopilot behaves.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkOptions {
    /// Where the autopilot is.
    pub address: Address,
    /// The message that carries positions. `None`: [`Output::for_autopilot`].
    pub output: Option<Output>,
    /// The autopilot's MAVLink system. `None`: the first one that is heard, and none but that one later.
    pub system_id: Option<u8>,
    /// Positions with a 95 % radius above this are not sent, metres.
    pub max_radius95_m: f64,
    /// Whether an autopilot that has no origin, since it never had a position, is told the first position as its origin.
    pub set_origin: bool,
    /// What is read of the autopilot's telemetry.
    pub telemetry: TelemetryOptions,
    /// The key with which messages are signed.
    pub signing: Option<SigningKey>,
    /// The number of the GNSS receiver that [`Output::GpsInput`] stands for.
    pub gps_id: u8,
    /// Send nothing, and tell what would be sent.
    pub dry_run: bool,
}

impl LinkOptions {
    /// The usual options for an address.
    #[must_use]
    pub fn new(address: Address) -> Self {
        Self {
            address,
            output: None,
            system_id: None,
            max_radius95_m: MAX_RADIUS95_M,
            set_origin: true,
            telemetry: TelemetryOptions::default(),
            signing: None,
            gps_id: 0,
            dry_run: false,
        }
    }
}
