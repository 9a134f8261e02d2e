//! What can go wrong in this crate.

use std::path::PathBuf;

use grimnet_kernels::KernelError;

/// An error of the network crate. Each message says what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// A file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A model file is not one of ours, or is damaged.
    #[error(
        "{path}: not a usable grimnet model: {reason}; take a model written by `grim train` or download it again"
    )]
    ModelFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Parameters do not fit the network description.
    #[error("the parameters do not fit the network: {reason}")]
    Parameters {
        /// Which tensor, and how it differs.
        reason: String,
    },
    /// A network description that cannot be built.
    #[error("the network description is not valid: {reason}")]
    Spec {
        /// Which rule it breaks.
        reason: String,
    },
    /// A picture whose sides are not positive multiples of 32 pixels.
    #[error(
        "the picture is {width_px} x {height_px} px: the network needs sides that are multiples of 32 px and at least 32; resample or pad it"
    )]
    ImageSize {
        /// Width of the picture.
        width_px: u32,
        /// Height of the picture.
        height_px: u32,
    },
    /// A mask whose size is not the picture's.
    #[error(
        "the mask is {mask_width_px} x {mask_height_px} px but the picture is {width_px} x {height_px} px: they must be of one size"
    )]
    MaskSize {
        /// Width of the mask.
        mask_width_px: u32,
        /// Height of the mask.
        mask_height_px: u32,
        /// Width of the picture.
        width_px: u32,
        /// Height of the picture.
        height_px: u32,
    },
    /// Normalisation statistics that belong to another network, or damaged bytes.
    #[error(
        "the normalisation statistics cannot be used: {reason}; gather them again with this model"
    )]
    Statistics {
        /// What is wrong with them.
        reason: String,
    },
    /// A convolution kernel refused its shape.
    #[error(transparent)]
    Kernel(#[from] KernelError),
}
