//! Attitude, height and velocity from elsewhere, as inputs of the filter.

mod csv;
mod dji_srt;
mod file;
mod klv;
mod klv_value;
pub(crate) mod mavlink;
mod mpeg_ts;
mod recorded;

pub use self::file::read_telemetry;
pub use self::recorded::{Telemetry, TelemetryClock};
