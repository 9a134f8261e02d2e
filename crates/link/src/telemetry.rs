//! Attitude, height and velocity from elsewhere, as inputs of the filter.

pub(crate) mod camera_mount;
mod csv;
mod dji_srt;
mod file;
mod gimbal;
mod klv;
mod klv_value;
pub(crate) mod mavlink;
mod mpeg_ts;
mod recorded;

pub use self::file::read_telemetry;
pub use self::mpeg_ts::LONGEST_STREAM_GAP_S;
pub use self::recorded::{Telemetry, TelemetryClock, VELOCITY_SIGMA_M_S};
