//! What the command-line programs of this workspace share.
//!
//! [`general::GeneralOptions`] starts the log and the threads, [`exit::Exit`] is how a run ends, [`errors`] puts errors into words.
//! [`values`] parses options; [`model_choice`], [`map_place`], [`limits_choice`] and [`outputs`]
//! are groups of them. [`progress`] shows long work and
//! [`interrupt`] stops it.

pub mod errors;
pub mod exit;
pub mod file_size;
pub mod general;
pub mod heading_modes;
pub mod inputs;
pub mod interrupt;
pub mod limits_choice;
pub mod map_place;
pub mod model_choice;
pub mod outputs;
pub mod progress;
pub mod terminal;
pub mod values;
