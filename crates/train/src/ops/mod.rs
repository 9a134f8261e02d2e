//! Convolution and normalisation with their own CPU kernels and backward passes.
//!
//! On the CPU (`Device::flex`) the NHWC convolution and the fused normalisation + ReLU use these kernels; on other devices they
//! are composed of burn's operations. Tests compare values and gradients of both.

mod composed;
pub mod convolution;
mod dispatch;
pub mod normalisation;
mod running_moments;

pub use dispatch::{conv3x3, norm_relu, transposed_conv4x4};
pub use normalisation::{Group, Moments};
pub use running_moments::follow_moments;
