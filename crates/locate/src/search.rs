//! Where a photo may lie: hypotheses of heading and scale, tiles found by descriptor, and the vote that ranks them.

pub mod candidates;
pub mod cascade;
pub mod hypotheses;
pub mod map_vote;
pub mod matching;
mod nearest;
pub mod scratch;
pub mod vote;
