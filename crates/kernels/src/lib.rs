//! Convolution, pooling and matrix kernels of the grimnet network, selected for the processor at run time.
//!
//! Activations are [`Tensor`]s: one image, channels innermost, with a halo of one pixel of zeros. Layers are built once from
//! weights in PyTorch's layout ([`Conv2d`], [`ConvTranspose2d`]) and run many times. The work is distributed over the current
//! rayon pool; results do not depend on the number of threads.
//!
//! Constructors return errors. The functions that compute treat arguments whose shapes do not fit each other as programming
//! errors and panic; each says so under `# Panics`.
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod buffer;
mod cache;
mod conv;
mod direct;
mod dot_products;
mod error;
mod isa;
mod layout;
mod matmul;
mod matmul_i8;
mod matrix;
mod norm;
mod panel;
mod parallel;
mod pool;
mod quantised;
mod resize;
mod simd;
#[cfg(feature = "training")]
pub mod strided_product;
mod tensor;
pub mod train;
mod transposed;
mod winograd;
mod workspace;

pub use conv::{Activation, Conv2d, ConvSpec};
pub use dot_products::{Stored, matmul_nt_stored};
pub use error::KernelError;
pub use isa::{ISA_VARIABLE, Isa, SelectIsaError, UnknownIsa};
pub use matmul::{matmul_nn, matmul_nt};
pub use matmul_i8::{matmul_nt_i8, matmul_nt_i8_by_rows};
pub use matrix::{MatMut, MatRef};
pub use norm::{channel_moments, scale_shift};
pub use pool::max_pool_2x2;
pub use quantised::{
    ByteScale, ByteTensor, QuantisedConv2d, QuantisedWeights, UpsampledSum, upsample_add_exact,
};
pub use resize::upsample_bilinear_add;
pub use simd::PlainKernel;
pub use tensor::Tensor;
pub use transposed::ConvTranspose2d;
pub use workspace::Workspace;
