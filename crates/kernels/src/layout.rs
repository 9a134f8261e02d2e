//! Copies the rows of a matrix into panels of its columns (a transposition).

use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;

/// `to[i * to_stride + c] = from[c * plane + i]` for `count` pixels `i` and `channels` channels, with zeros from `channels`
/// up to `block` channels.
pub(crate) struct Interleave {
    from: *const f32,
    plane: usize,
    channels: usize,
    count: usize,
    to: *mut f32,
    to_stride: usize,
    block: usize,
}

/// The shape of an [`Interleave`].
#[derive(Clone, Copy)]
pub(crate) struct InterleaveShape {
    /// Floats from one channel of `from` to the next.
    pub(crate) plane: usize,
    /// Channels of `from`.
    pub(crate) channels: usize,
    /// Pixels.
    pub(crate) count: usize,
    /// Floats from one pixel of `to` to the next.
    pub(crate) to_stride: usize,
    /// Channels of `to`, at least `channels`.
    pub(crate) block: usize,
}

impl Interleave {
    /// # Safety
    /// Until the kernel has run, `count` floats must be readable at `from + c * plane` for each channel, and `block`
    /// floats must be writable at `to + i * to_stride` for each pixel, without other threads reading or writing them. The
    /// two ranges must not overlap.
    pub(crate) unsafe fn new(from: *const f32, to: *mut f32, shape: InterleaveShape) -> Self {
        let InterleaveShape {
            plane,
            channels,
            count,
            to_stride,
            block,
        } = shape;
        Self {
            from,
            plane,
            channels,
            count,
            to,
            to_stride,
            block,
        }
    }
}

impl Kernel for Interleave {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            from,
            plane,
            channels,
            count,
            to,
            to_stride,
            block,
        } = self;
        let vectors = if count >= S::LANES {
            channels / S::LANES * S::LANES
        } else {
            0
        };
        // SAFETY: the contract of `new`; squares begin at `count - LANES` at most.
        unsafe {
            for c in (0..vectors).step_by(S::LANES) {
                for i in (0..count).step_by(S::LANES) {
                    // The last square overlaps the one before rather than the end.
                    let i = i.min(count - S::LANES);
                    simd.transpose(
                        from.add(c * plane + i),
                        plane,
                        to.add(i * to_stride + c),
                        to_stride,
                    );
                }
            }
            for i in 0..count {
                for c in vectors..channels {
                    *to.add(i * to_stride + c) = *from.add(c * plane + i);
                }
                for c in channels..block {
                    *to.add(i * to_stride + c) = 0.0;
                }
            }
        }
    }
}

/// Number of channels in the block that starts at `channel`.
pub(crate) fn block_channels(channels: usize, channel: usize) -> usize {
    channels.saturating_sub(channel).min(CHANNEL_BLOCK)
}
