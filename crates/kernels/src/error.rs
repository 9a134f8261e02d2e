//! What can be wrong with the arguments of a kernel's constructor.

/// A convolution that cannot be built from what was given.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KernelError {
    /// The kernel side is neither 1 nor 3.
    #[error("convolution kernel of side {0} is not supported: use 1 or 3")]
    UnsupportedKernel(usize),
    /// The stride is neither 1 nor 2.
    #[error("convolution stride {0} is not supported: use 1 or 2")]
    UnsupportedStride(usize),
    /// A channel count is zero.
    #[error("a convolution needs at least one input and one output channel")]
    NoChannels,
    /// The weight slice does not have `out x in x kernel x kernel` elements.
    #[error(
        "convolution weight has {found} elements, {expected} are needed for its channels and kernel"
    )]
    WeightLength {
        /// Elements that the specification asks for.
        expected: usize,
        /// Elements that were given.
        found: usize,
    },
    /// The bias slice does not have one element for each output channel.
    #[error("convolution bias has {found} elements, {expected} output channels need as many")]
    BiasLength {
        /// Output channels.
        expected: usize,
        /// Elements that were given.
        found: usize,
    },
}
