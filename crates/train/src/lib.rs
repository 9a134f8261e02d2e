//! Training the GRiM-Net network: modules, losses, data, loop, export.

mod aside;
mod batch;
mod centres;
mod checkpoint;
mod config;
mod curves;
pub mod data;
mod detector;
mod device;
mod error;
mod export;
mod first;
mod grow;
pub mod import;
mod labelling;
pub mod loss;
mod memory;
mod network;
mod objective;
pub mod ops;
mod optimiser;
mod parameters;
mod scene_accuracy;
mod schedule;
mod teacher;
#[cfg(test)]
mod test_numbers;
mod trainer;
mod validation;
mod validator;
mod whitening;

pub use burn::tensor::Device;

pub use batch::{InputBuilder, Norms, input_of};
pub use centres::start_centres;
pub use checkpoint::{Checkpoint, Position};
pub use config::{DescriptorLoss, GlobalLoss, Stage, TrainConfig, Weights};
pub use curves::Curves;
pub use detector::Detector;
pub use device::Accelerator;
pub use error::TrainError;
pub use export::{ExportOptions, Exported, export, save_model, with_fresh_statistics};
pub use labelling::{LabelProgress, label_pictures};
pub use network::{Input, Network, Output, Part, Statistics};
pub use objective::Losses;
pub use optimiser::Adam;
pub use parameters::Parameters;
pub use scene_accuracy::{SceneAccuracy, scene_accuracy};
pub use teacher::TeacherOptions;
pub use trainer::{Progress, Trainer, checkpoint_path};
pub use validation::{Sight, Validation, Validations, pairs_of, validation_options};
pub use validator::{Figures, Validator};
pub use whitening::{PrincipalAxes, Projection, WhiteningKind};
