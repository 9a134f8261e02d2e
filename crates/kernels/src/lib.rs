//! Convolution, pooling and matrix kernels for the grimnet network, chosen for the processor at run time.
//!
//! Activations are [`Tensor`]s: one image, channels innermost, with a zero halo of one pixel. Layers are made once from
//! PyTorch-shaped weights ([`Conv2d`], [`ConvTranspose2d`]) and run many times. Work is spread over the current rayon
//! pool; a result does not depend on the number of threads.

mod buffer;
mod conv;
mod direct;
mod error;
mod isa;
mod layout;
mod matmul;
mod matmul_i8;
mod norm;
mod panel;
mod parallel;
mod pool;
mod resize;
mod simd;
mod tensor;
pub mod train;
mod transposed;
mod winograd;
mod workspace;

pub use conv::{Activation, Conv2d, ConvSpec};
pub use error::KernelError;
pub use isa::{ISA_VARIABLE, Isa, UnknownIsa};
pub use matmul::{matmul_nn, matmul_nt};
pub use matmul_i8::matmul_nt_i8;
pub use norm::{channel_moments, scale_shift};
pub use pool::max_pool_2x2;
pub use resize::upsample_bilinear_add;
pub use simd::PlainKernel;
pub use tensor::Tensor;
pub use transposed::ConvTranspose2d;
pub use workspace::Workspace;
