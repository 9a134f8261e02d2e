//! Hands the position of a track to an autopilot and reads telemetry for it.
//!
//! - [`Link`] talks MAVLink 2 with ArduPilot or PX4 over UDP, TCP or a serial port: it reads attitude, height and velocity as
//!   [`grimnet_track::Input`]s and sends positions in the message, frame, rate and covariance that the autopilot reads
//!   ([`Output`]). Nothing is sent while the track is searching, ambiguous or lost.
//! - [`NmeaOutput`] writes GGA and RMC sentences for other receivers.
//! - [`check()`] reads an autopilot's parameters and says which must change: what is sent with wrong ones is dropped in silence.
//! - [`read_telemetry`] reads recorded telemetry: CSV, DJI's SRT subtitles, MISB ST 0601 KLV.
//!
//! The contracts were read in the sources of ArduPilot 4.5 to 4.7 and of PX4 1.15 to 1.18.

mod address;
mod autopilot;
mod check;
mod clock;
mod connection;
mod describe;
mod error;
mod event;
mod every;
mod exchange;
mod gate;
mod gnss;
#[cfg(test)]
mod golden_tests;
mod link;
mod messages;
mod nmea;
mod nmea_output;
mod options;
mod output;
mod parameters;
mod projection;
mod reopened;
mod requests;
mod rules;
mod session;
#[cfg(test)]
mod session_tests;
mod signing;
mod telemetry;
mod time_sync;
mod time_text;
mod transport;

pub use address::{Address, AddressError};
pub use autopilot::{Autopilot, AutopilotKind, Version};
pub use check::{CheckOptions, CheckReport, check};
pub use clock::LinkClock;
pub use error::LinkError;
pub use event::{LinkEvent, NotSending};
pub use link::{Link, LinkStatus, PointAt};
pub use nmea::nmea_sentences;
pub use nmea_output::{NmeaOutput, NmeaTarget, NmeaTargetError};
pub use options::{LinkOptions, MAX_RADIUS95_M};
pub use output::Output;
pub use rules::{Finding, Verdict};
pub use signing::SigningKey;
pub use telemetry::camera_mount::CameraMount;
pub use telemetry::mavlink::TelemetryOptions;
pub use telemetry::{
    LONGEST_STREAM_GAP_S, Telemetry, TelemetryClock, VELOCITY_SIGMA_M_S, read_telemetry,
};
