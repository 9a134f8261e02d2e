//! Evaluation of tracks: flights over a procedural town rendered in pixels, simulated hours from the statistics of their fixes, and
//! hidden fixes of a real flight.
//!
//! A filter's figures mean little without its controls, so three runs are always compared: fixes only, motion only, and the
//! filter.

pub mod about;
pub mod figures;
pub mod figures_table;
pub mod frame_figures;
pub mod frame_record;
pub mod ground_cover;
pub mod hidden;
pub mod hidden_figures;
pub mod hidden_results;
pub mod plots;
pub mod rendered;
pub mod results;
pub mod simulated;
pub mod stored_flight;
pub mod three_runs;
pub mod town;
