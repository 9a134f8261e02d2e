//! The training run.

mod batch_targets;
pub(crate) mod checkpoint;
pub(crate) mod curves;
pub(crate) mod data;
pub(crate) mod detector;
pub(crate) mod labelling;
pub(crate) mod losses;
mod memory;
mod objective;
pub(crate) mod optimiser;
pub(crate) mod report;
pub(crate) mod resume;
pub(crate) mod run_folder;
mod schedule;
mod start;
pub(crate) mod step_table;
pub(crate) mod trainer;
