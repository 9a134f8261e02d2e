//! Simulated flights: what the filter would be told, and the truth.
//!
//! The errors that are drawn are those that the filter's options describe (the map's offset, boresight, attitude, velocity),
//! but also what they do not describe: banked turns, gusts, fixes of other places that repeat from frame to frame, late and
//! swapped fixes, and being put elsewhere.

mod errors;
mod path;
mod report;
mod runs;

pub use errors::Confidence;
pub use path::Camera;
pub use report::{Delivered, Flight, FlightOptions, Gaps};
pub use runs::{Runs, fixes_only, motion_only, run_filter};
