//! Transposing copies from the rows of a matrix to panels of its columns.

use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;

/// `to[i * to_stride + c] = from[c * plane + i]` for `count` pixels `i` and `channels` channels, with zeros up to
/// `block` channels.
///
/// Whoever makes one promises that all of `from` is readable, all of `to` writable by nobody else, and that they do not
/// overlap.
pub(crate) struct Interleave {
    pub(crate) from: *const f32,
    pub(crate) plane: usize,
    pub(crate) channels: usize,
    pub(crate) count: usize,
    pub(crate) to: *mut f32,
    pub(crate) to_stride: usize,
    pub(crate) block: usize,
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
        // SAFETY: the maker's promise; squares begin at `count - LANES` at most.
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

/// Channels of the block that starts at `channel`.
pub(crate) fn block_channels(channels: usize, channel: usize) -> usize {
    channels.saturating_sub(channel).min(CHANNEL_BLOCK)
}
