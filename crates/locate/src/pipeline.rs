//! The stages from a photo to an answer in default mode.
//!
//! The stages are functions over a [`crate::context::Context`]; the result of a round holds the wall time of its stages.

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
