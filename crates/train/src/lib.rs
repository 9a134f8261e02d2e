//! Training the GRiM-Net network: modules, losses, data, loop, export.

mod batch;
mod centres;
mod checkpoint;
mod config;
pub mod data;
mod error;
mod export;
pub mod loss;
mod network;
pub mod ops;
mod optimiser;
mod parameters;
mod trainer;
mod validation;
mod whitening;

pub use batch::{InputBuilder, input_of};
pub use centres::{start_centres, unit_clusters};
pub use checkpoint::{Checkpoint, Position};
pub use config::{TrainConfig, Weights};
pub use error::TrainError;
pub use export::{ExportOptions, Exported, export, save_model, with_fresh_statistics};
pub use network::{Input, Network, Output, Part, Statistics};
pub use optimiser::Adam;
pub use parameters::Parameters;
pub use trainer::{Losses, Progress, Trainer, checkpoint_path, sources_of};
pub use validation::{Validation, pairs_of, validate, validation_options};
pub use whitening::{Projection, WhiteningKind, fit_whitening};
