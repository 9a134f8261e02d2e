//! Networks of the form of GRiM-Net on the CPU: network description, model file, inference.
//!
//! A [`NetSpec`] describes a network (presets: `compact`, the default, and three variants of the paper's VGG-16); a
//! [`Model`] is a description with its weights; an [`Extractor`] is a model prepared for one [`Domain`] (normalisation
//! folded into the convolutions) and computes the [`Features`] of an image: keypoints, local descriptors and one global
//! descriptor.
//!
//! Pixel convention: keypoints are integer pixel indices, so the centre of the top-left pixel is (0, 0). Add one half to
//! get continuous image coordinates.
//!
//! ```
//! use grimnet_net::{Domain, ExtractOptions, Extractor, Model, NetSpec};
//!
//! let model = Model::random(&NetSpec::compact(), 7)?;
//! let extractor = Extractor::new(&model, Domain::Uav)?;
//! let image = image::RgbImage::from_fn(64, 96, |x, y| image::Rgb([(x * 4) as u8, (y * 2) as u8, 90]));
//! let features = extractor.extract(&image, None, &ExtractOptions::default())?;
//! assert_eq!(features.global.len(), 1024);
//! assert_eq!(features.descriptors.len(), features.keypoints.len() * features.descriptor_dim);
//! # Ok::<(), grimnet_net::NetError>(())
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod activation_range;
mod bundled;
mod byte_network;
mod calibration;
mod card;
mod dense;
mod describe;
mod error;
mod extractor;
mod features;
mod file;
mod forward;
mod heatmap;
mod input;
mod k_means;
mod keypoint_layers;
mod keypoints;
mod layer;
mod model;
mod model_hash;
mod paper_network;
mod parameter;
mod parameter_names;
mod precision;
mod random;
mod seen;
mod softmax;
mod spec;
mod spec_check;
mod statistics;
mod vlad;
mod whitening;

pub use calibration::{Calibration, Confidence, FittedOn, PositionError};
pub use card::Card;
pub use dense::Dense;
pub use describe::normalise;
pub use error::{
    CalibrationError, ModelFileError, NetError, ParameterError, SpecError, StatisticsError,
};
pub use extractor::Extractor;
pub use features::{ExtractOptions, Features, Keypoint};
pub use k_means::{KMeans, nearest_by_distance, nearest_by_product};
pub use model::Model;
pub use model_hash::ModelHash;
pub use parameter::{DataType, Parameter};
pub use precision::{Precision, Purpose, UnknownPrecision};
pub use spec::{
    BATCH_NORM_EPSILON, Decoder, Domain, Downsample, KEYPOINT_CELL_PX, KEYPOINT_CLASSES,
    KeypointHead, NetSpec, SIZE_MULTIPLE_PX, Stage, Vlad, VladInput,
};
pub use statistics::{LayerStatistics, Statistics};
pub use vlad::VladSum;
