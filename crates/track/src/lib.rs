//! Follows an aircraft over single fixes, motion between frames, attitude, height and the autopilot's velocity.
//!
//! [`Tracker`] takes [`Input`]s, each with the time at which it was true, and gives a [`TrackPoint`] for any time: position,
//! velocity, heading, covariance, and a [`TrackState`] that says whether it may be used.
//!
//! # Method
//! - A bank of at most eight small Kalman filters, each a hypothesis of where the aircraft is (Gaussian-sum filter: Alspach and
//!   Sorenson 1972). A fix is gated by chi-square; a fix that no hypothesis accepts founds a new one; where fixes lie and
//!   their calibrated confidence decide how fast one hypothesis outweighs another. The track is usable only while those of one
//!   place hold at least 95 % of the weight together.
//! - What all fixes have in common (the map's error, the camera's unknown tilt) does not average out: it is carried as
//!   considered states (Schmidt 1966).
//! - The aircraft is not the image centre. With attitude and height the position is the aircraft's, and the camera's boresight
//!   is estimated; without them [`Estimate::position_of`] says so and the covariance has the unknown tilt in it.
//! - [`smooth`] goes over a recorded flight forward and backward (Rauch, Tung and Striebel 1965).
//! - Inputs may come up to 30 s late and in any order. The state is the same, bit for bit, as if they had come in order.
//!
//! # Frames and units
//! Positions are metres east and north in a local plane, angles degrees, headings clockwise from true north, times seconds on
//! one clock that all inputs share.

mod alias_rate;
mod attitude;
mod bank;
mod climb;
mod clock_watch;
mod confidence;
mod dead_reckoning;
mod error;
mod filter;
mod gauss_markov;
mod hypothesis;
mod hypothesis_merge;
mod input;
mod input_check;
mod journal;
mod kalman;
mod lag;
pub mod measure;
mod observation;
mod options;
mod plane;
mod point;
mod propagation;
mod radius;
mod reference;
mod rts;
mod scalar;
mod sensors;
#[cfg(any(test, feature = "simulation"))]
pub mod simulation;
mod smoother;
mod tilt;
mod tilt_error;
mod tracker;
mod velocity_gate;
mod window;

pub use attitude::{Attitude, FixedMount};
pub use error::{InputError, OptionsError};
pub use hypothesis::PositionOf;
pub use input::{HEIGHT_AGL_RANGE_M, Height, Input, Miss, PositionFix, RelativeMotion, Velocity};
pub use lag::Taken;
pub use options::{GATE_99_9_PERCENT, Start, TrackOptions, Vehicle};
pub use point::{Estimate, Source, TrackPoint, TrackState};
pub use radius::radius95_m;
pub use smoother::{SmoothedPoint, smooth};
pub use tracker::{InputCounts, Tracker};
pub use window::{Search, SearchWindow};
