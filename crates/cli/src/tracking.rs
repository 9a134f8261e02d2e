//! Following a flight: where frames come from, the track as it is written, recordings.

pub mod ffmpeg;
pub mod following;
pub mod formats;
pub mod frame_clock;
pub mod frame_time;
pub mod frames;
pub mod handover;
pub mod jpeg_stream;
pub mod line;
pub mod live;
pub mod nmea_rows;
mod own_clock;
mod pace;
pub mod photo_list;
pub mod recorded_telemetry;
pub mod recording;
pub mod session;
pub mod smoothed;
pub mod standard_input;
pub mod truth;
pub mod video;
#[cfg(feature = "video")]
pub mod video_file;
