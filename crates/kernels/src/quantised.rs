//! Convolutions of bytes: unsigned activations, signed weights, exact sums in 32 bits.
//!
//! A byte stands for a real number, `value = scale * (byte - zero)` with a scale and a zero for each channel ([`ByteScale`]). The
//! scales of the input's channels are folded into the weights, which then have one scale for each output channel (Jacob et al. 2018,
//! "Quantization and training of neural networks for efficient integer-arithmetic-only inference"): a sum of products times the
//! `unit` of its output channel is the real number ([`QuantisedWeights`]). Bias and zeros of the input are where the sums start.
//!
//! Sums are exact and what follows is a product and a rounding, so that all instruction sets give the same bytes and floats.

mod conv;
mod dots;
mod pack;
mod tensor;
mod tile;
mod upsample;
mod weights;

pub use conv::QuantisedConv2d;
pub use tensor::ByteTensor;
pub use upsample::{UpsampledSum, upsample_add_exact};
pub use weights::{ByteScale, QuantisedWeights};

/// See [`crate::Isa::has_byte_products`].
pub(crate) fn has_byte_products(isa: crate::Isa) -> bool {
    dots::Dots::of(isa).is_native()
}
