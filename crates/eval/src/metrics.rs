//! Figures of accuracy, of stated uncertainty and of retrieval.

pub mod footprint;
mod frame;
mod places;
pub mod rank_distance;
pub mod recall;
pub mod reliability;
pub mod risk_coverage;
pub mod statistics;
mod summary;

pub(crate) use frame::rounded;
pub use frame::{Frame, ScoredFix};
pub use summary::{CONFIDENTLY_WRONG_M, CONFIDENTLY_WRONG_SIGMA, Summary};
