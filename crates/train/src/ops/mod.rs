//! Operations that burn's CPU backend does slowly, with their own backward passes.
//!
//! On the CPU (`Device::flex`) the NHWC convolution and the fused normalisation + ReLU are ours; on any other device the
//! same functions are composed of burn's operations. Both are tested to agree, values and gradients.

pub mod convolution;
mod dispatch;
pub mod normalisation;
pub mod strided_product;

pub use dispatch::{conv3x3, follow_moments, norm_relu};
pub use normalisation::{Group, Moments};
