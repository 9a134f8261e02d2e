//! The stages from a photo to an answer in default mode.
//!
//! Each stage is a function over a [`crate::context::Context`] and returns its wall time with its result.

pub mod answer;
pub mod chance;
pub mod finalists;
pub mod gates;
pub mod ground_position;
pub mod guided_matching;
pub mod held_back;
pub mod queries;
pub mod ranking;
pub mod realign;
pub mod round_result;
pub mod rounds;
pub mod run;
pub mod tile_frame;
pub mod verification;
