//! Training the GRiM-Net network: modules, losses, data, loop, export.

mod batch;
mod centres;
mod checkpoint;
mod config;
mod curves;
pub mod data;
mod device;
mod error;
mod export;
mod first;
pub mod import;
pub mod loss;
mod memory;
mod network;
mod objective;
pub mod ops;
mod optimiser;
mod parameters;
mod schedule;
mod teacher;
mod trainer;
mod validation;
mod validator;
mod whitening;

pub use burn::tensor::Device;

pub use batch::{InputBuilder, Norms, input_of};
pub use centres::{start_centres, unit_clusters};
pub use checkpoint::{Checkpoint, Position};
pub use config::{DescriptorLoss, GlobalLoss, TrainConfig, Weights};
pub use curves::Curves;
pub use device::Accelerator;
pub use error::TrainError;
pub use export::{ExportOptions, Exported, export, save_model, with_fresh_statistics};
pub use network::{Input, Network, Output, Part, Statistics};
pub use objective::Losses;
pub use optimiser::Adam;
pub use parameters::Parameters;
pub use teacher::TeacherOptions;
pub use trainer::{Progress, Trainer, checkpoint_path};
pub use validation::{Validation, Validations, pairs_of, validate, validation_options};
pub use validator::Validator;
pub use whitening::{Projection, WhiteningKind, fit_whitening};
