//! Errors of this crate.

use std::path::PathBuf;

use grimnet_kernels::KernelError;

use crate::Precision;

/// An error of the network crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error(transparent)]
    Output(#[from] grimnet_output::OutputError),
    /// A file is not a usable model.
    #[error("{path}: not a usable grimnet model: {reason}")]
    ModelFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: ModelFileError,
    },
    /// The tensors do not fit the network description.
    #[error("the tensors do not fit the network: {0}")]
    Parameters(ParameterError),
    /// The network described cannot be built.
    #[error("the network description is not valid: {0}")]
    Spec(SpecError),
    /// The calibration holds a value that is out of range.
    #[error("the calibration is not valid: {0}")]
    Calibration(CalibrationError),
    /// The sides of an image are not positive multiples of 32 pixels.
    #[error(
        "the image is {width_px} x {height_px} px; expected sides that are multiples of 32 px, at least 32: resample or pad the image"
    )]
    ImageSize {
        /// Width of the image.
        width_px: u32,
        /// Height of the image.
        height_px: u32,
    },
    /// The mask and the image differ in size.
    #[error(
        "the mask is {mask_width_px} x {mask_height_px} px but the image is {width_px} x {height_px} px; expected the same size"
    )]
    MaskSize {
        /// Width of the mask.
        mask_width_px: u32,
        /// Height of the mask.
        mask_height_px: u32,
        /// Width of the image.
        width_px: u32,
        /// Height of the image.
        height_px: u32,
    },
    /// Normalisation statistics cannot be used with this model, or their bytes are damaged.
    #[error("the normalisation statistics cannot be used: {0}; compute them again with this model")]
    Statistics(StatisticsError),
    /// The whitening projection was asked for in another precision, and the model has none.
    #[error("the model has no whitening projection whose precision could be changed")]
    NoWhitening,
    /// The network cannot be computed in this precision.
    #[error(
        "network `{preset}` cannot be computed in {precision}: that is made for networks of the form of `compact`; use f32"
    )]
    UnsupportedPrecision {
        /// The network.
        preset: String,
        /// The precision asked for.
        precision: Precision,
    },
    /// A convolution kernel does not support a layer's shape.
    #[error(transparent)]
    Kernel(#[from] KernelError),
}

/// Why a file is not a usable model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// The file is larger than any model.
    #[error(
        "it has {found} bytes, more than the limit of {limit}; expected a model written by this program"
    )]
    TooLarge {
        /// Its size, bytes.
        found: u64,
        /// Largest file that is read, bytes.
        limit: u64,
    },
    /// The file does not follow the safetensors format.
    #[error("not a safetensors file ({0}); download or export the model again")]
    NotSafetensors(String),
    /// An entry of the metadata that every model has is missing.
    #[error(
        "its metadata has no entry `{0}`: expected a model written by this program; a checkpoint of a training run is none until it is exported"
    )]
    MissingMetadata(&'static str),
    /// The format version is not supported.
    #[error(
        "its format version is `{found}`, expected `1` or `2`; use a program version that supports it, or export the model again"
    )]
    Version {
        /// The version in the file.
        found: String,
    },
    /// An entry of the metadata is not the JSON that is expected there.
    #[error("its metadata entry `{entry}` cannot be read ({reason}); export the model again")]
    Metadata {
        /// `spec`, `card` or `calibration`.
        entry: &'static str,
        /// What the JSON parser reports.
        reason: String,
    },
    /// The checksum in the file is not that of its bytes.
    #[error(
        "damaged: its checksum does not match its contents (expected {expected}, computed {computed}); download or export the model again"
    )]
    Checksum {
        /// The checksum in the file, hexadecimal.
        expected: String,
        /// The checksum of the file's bytes, hexadecimal.
        computed: String,
    },
    /// A tensor has a data type that is not supported for it.
    #[error("tensor `{name}` has data type {found}, expected {expected}; export the model again")]
    DataType {
        /// The tensor.
        name: String,
        /// The data type in the file.
        found: String,
        /// The supported data types.
        expected: &'static str,
    },
    /// The tensors do not fit the network description.
    #[error("its tensors do not fit its network: {0}; export the model again")]
    Parameters(ParameterError),
    /// The network described cannot be built.
    #[error("its network description is not valid: {0}; export the model again")]
    Spec(SpecError),
    /// The calibration holds a value that is out of range.
    #[error("its calibration is not valid: {0}; calibrate the model again")]
    Calibration(CalibrationError),
}

/// How a set of tensors differs from what a network description needs.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParameterError {
    /// A tensor is missing.
    #[error("tensor `{0}` is missing")]
    Missing(String),
    /// The network has no tensor of this name.
    #[error("network `{preset}` has no tensor `{name}`")]
    Unknown {
        /// The tensor.
        name: String,
        /// The network.
        preset: String,
    },
    /// A tensor has another shape or number of values.
    #[error("tensor `{name}` has shape {found:?} ({values} values), expected {expected:?}")]
    Shape {
        /// The tensor.
        name: String,
        /// Its shape.
        found: Vec<usize>,
        /// Its number of values.
        values: usize,
        /// The shape that the network needs.
        expected: Vec<usize>,
    },
    /// A tensor holds NaN or an infinite value.
    #[error("tensor `{0}` holds a value that is not a finite number")]
    NotFinite(String),
    /// A variance is negative.
    #[error("tensor `{0}` holds a negative variance")]
    NegativeVariance(String),
}

/// Why a network description is not valid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SpecError {
    /// The encoder has another number of stages than five.
    #[error("it has {found} stages, expected {expected}")]
    Stages {
        /// Stages of the description.
        found: usize,
        /// Stages that are supported.
        expected: usize,
    },
    /// A stage, or the keypoint head, has an unsupported number of layers.
    #[error("{part} has {found} layers, expected {min} to {max}")]
    Layers {
        /// Which part of the network.
        part: &'static str,
        /// Its layers.
        found: usize,
        /// Fewest that are supported.
        min: usize,
        /// Most that are supported.
        max: usize,
    },
    /// A layer's width or the number of clusters is out of range.
    #[error("a layer has {found} channels (or NetVLAD clusters), expected 1 to {max}")]
    Width {
        /// Channels or clusters.
        found: usize,
        /// Most that are supported.
        max: usize,
    },
    /// A layer of the encoder would take too much memory.
    #[error(
        "a layer of the encoder has {found} values for each pixel of the image, expected at most {max}"
    )]
    Activation {
        /// Values of its output per pixel of the image.
        found: usize,
        /// Most that are supported.
        max: usize,
    },
    /// The lateral decoder's width is not that of the third stage, to which it is added.
    #[error("the lateral decoder has {decoder} channels, expected the third stage's {stage}")]
    DecoderWidth {
        /// Channels of the decoder.
        decoder: usize,
        /// Channels of the third stage.
        stage: usize,
    },
    /// Whitening cannot give that many values.
    #[error("whitening to {found} values, expected at most {max}")]
    GlobalDim {
        /// Length of the global descriptor.
        found: usize,
        /// Longest that is supported.
        max: usize,
    },
    /// The input normalisation is not finite, or divides by a number that is not positive.
    #[error("the input's mean and standard deviation must be finite, and the latter positive")]
    InputNormalisation,
    /// The description cannot be written as JSON.
    #[error("it cannot be written as JSON ({0})")]
    Json(String),
}

/// Which value of a calibration is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[error("`{field}` is {found}, expected a finite number {expected}")]
pub struct CalibrationError {
    /// The field, as it is named in the file.
    pub field: &'static str,
    /// Its value.
    pub found: f64,
    /// The range that is accepted.
    pub expected: &'static str,
}

/// Why normalisation statistics cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StatisticsError {
    /// They were computed with another model.
    #[error("they belong to another model")]
    OtherModel,
    /// There are none to average.
    #[error("there are none to average")]
    Empty,
    /// A share is outside 0 to 1.
    #[error("the share is {0}, expected 0 to 1")]
    Share(f64),
    /// The bytes are not those of statistics.
    #[error("the bytes are damaged or of another format ({0})")]
    Format(&'static str),
}
