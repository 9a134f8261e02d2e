//! Errors of the layers' constructors.

/// Why a convolution cannot be built.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// The kernel side is neither 1 nor 3.
    #[error("convolution kernel of side {0} is not supported; expected 1 or 3")]
    UnsupportedKernel(usize),
    /// The stride is neither 1 nor 2.
    #[error("convolution stride {0} is not supported; expected 1 or 2")]
    UnsupportedStride(usize),
    /// A channel count is zero.
    #[error("a convolution needs at least one input and one output channel")]
    NoChannels,
    /// The weight slice does not have `out x in x kernel x kernel` elements.
    #[error(
        "the convolution weight has {found} elements, expected {expected} (out x in x kernel x kernel)"
    )]
    WeightLength {
        /// Elements that the specification needs.
        expected: usize,
        /// Elements of the slice.
        found: usize,
    },
    /// The bias slice does not have one element for each output channel.
    #[error(
        "the convolution bias has {found} elements, expected one for each of {expected} output channels"
    )]
    BiasLength {
        /// Output channels.
        expected: usize,
        /// Elements of the slice.
        found: usize,
    },
    /// There is not one scale for each input channel.
    #[error(
        "there are scales of {found} channels, expected one for each of {expected} input channels"
    )]
    ScaleLength {
        /// Input channels.
        expected: usize,
        /// Channels that have a scale.
        found: usize,
    },
    /// A sum of so many products of bytes may not fit into 32 bits.
    #[error(
        "each output of the convolution is a sum of {products} products of bytes; at most {most} are supported"
    )]
    LongSum {
        /// Products in a sum.
        products: usize,
        /// Most that are supported.
        most: usize,
    },
}
