//! Training of networks of the form of GRiM-Net.
//!
//! [`TrainConfig`] describes a run, [`Data`] lists its pictures, [`Trainer`] runs it and writes [`Checkpoint`]s, and [`export`]
//! makes the model file that `grimnet-net` reads. The modules: `model` (the network on burn tensors), [`loss`], [`ops`] (operations
//! with their own CPU kernels), [`data`] (training pairs), `run` (the training loop), `measure` (validation and export), and
//! [`import`] (weights of other programs).

mod config;
pub mod data;
mod error;
pub mod import;
pub mod loss;
mod measure;
mod model;
pub mod ops;
mod output;
mod run;
#[cfg(test)]
mod test_numbers;

pub use burn::tensor::Device;

pub use config::{
    DescriptorLoss, ExportOptions, GlobalLoss, Stage, TrainConfig, Weights, WhiteningChoice,
};
pub use error::TrainError;
pub use measure::export::{Exported, export};
pub use measure::scene_accuracy::{SceneAccuracy, scene_accuracy};
pub use measure::statistics::with_export_statistics;
pub use measure::validation::{
    MatchingFigures, PairOutputs, Validation, Validations, pairs_of, validation_options,
};
pub use measure::validator::{Figures, Validator};
pub use measure::whitening::{PrincipalAxes, Projection, WhiteningKind};
pub use model::device::Accelerator;
pub use model::input::{Input, InputBuilder, Norms, Part, input_of};
pub use model::network::{Network, Output};
pub use model::normalisation::Statistics;
pub use model::parameters::Parameters;
pub use model::teacher::TeacherOptions;
pub use run::checkpoint::{Checkpoint, Position};
pub use run::curves::Curves;
pub use run::data::Data;
pub use run::detector::Detector;
pub use run::labelling::{LabelProgress, label_pictures};
pub use run::losses::Losses;
pub use run::optimiser::{Adam, AdamOptions, Moments, StepOptions};
pub use run::report::Progress;
pub use run::resume::{checkpoint_path, last_checkpoint};
pub use run::run_folder::{FLIGHT, MODEL, RunFolder};
pub use run::step_table::StepTable;
pub use run::trainer::Trainer;
