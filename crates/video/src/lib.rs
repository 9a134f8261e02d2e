//! Frames of MP4 and MOV videos (H.264, H.265) with the times at which they were taken, in Rust alone.
//!
//! [`Video::open`] reads the index of the file and tries the first frame; [`Video::at_rate`] decodes. The file is not read into
//! memory: frames are read one by one, and only those that are asked for become pictures. Frames that others are predicted from are
//! decoded as well; others are skipped, whole groups of pictures if they hold none that is asked for.
//!
//! ```no_run
//! use grimnet_video::Video;
//! let video = Video::open("DJI_0001.MP4", &grimnet_limits::PhotoLimits::DEFAULT)?;
//! for frame in video.at_rate(2.0)? {
//!     match frame.picture {
//!         Ok(picture) => println!("{:.3} s: {} px wide", frame.time_s, picture.width()),
//!         Err(error) => eprintln!("{error}"),
//!     }
//! }
//! # Ok::<(), grimnet_video::VideoError>(())
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod colour;
mod decoder;
mod edit_list;
mod error;
mod fields;
mod fragments;
#[cfg(test)]
mod golden_tests;
mod h264;
mod h265;
mod movie;
mod picture;
mod pixel_aspect;
mod rotation;
mod sample;
mod sample_entry;
mod sample_source;
mod sample_table;
mod selection;
mod stream_size;
mod video;
mod video_frames;

pub use error::VideoError;
pub use video::{Video, VideoInfo};
pub use video_frames::{VideoFrame, VideoFrames};
