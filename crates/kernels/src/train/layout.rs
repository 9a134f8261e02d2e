//! Between planes of channels (NCHW) and blocks of 16 channels.

use crate::buffer::AlignedBuffer;
use crate::parallel::{SharedMut, for_each};
use crate::simd::{Kernel, Simd};
use crate::tensor::CHANNEL_BLOCK;
use crate::{Isa, Tensor};

/// `to[i * to_stride + c] = from[c * plane + i]` for `count` pixels `i` and `channels` channels, with zeros up to
/// `block` channels.
///
/// Whoever makes one promises that all of `from` is readable, all of `to` writable by nobody else, and that they do not
/// overlap.
pub(super) struct Interleave {
    pub(super) from: *const f32,
    pub(super) plane: usize,
    pub(super) channels: usize,
    pub(super) count: usize,
    pub(super) to: *mut f32,
    pub(super) to_stride: usize,
    pub(super) block: usize,
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

/// `to[c * plane + i] = from[i * from_stride + c]` for `count` pixels `i` and `channels` channels, with the promises of
/// [`Interleave`].
pub(super) struct Separate {
    pub(super) from: *const f32,
    pub(super) from_stride: usize,
    pub(super) to: *mut f32,
    pub(super) plane: usize,
    pub(super) channels: usize,
    pub(super) count: usize,
}

impl Kernel for Separate {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            from,
            from_stride,
            to,
            plane,
            channels,
            count,
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
                    let i = i.min(count - S::LANES);
                    simd.transpose(
                        from.add(i * from_stride + c),
                        from_stride,
                        to.add(c * plane + i),
                        plane,
                    );
                }
            }
            for c in vectors..channels {
                for i in 0..count {
                    *to.add(c * plane + i) = *from.add(i * from_stride + c);
                }
            }
        }
    }
}

/// Copies an image `[channels, height, width]` into a tensor of that shape.
pub(super) fn tensor_from_planes(isa: Isa, planes: &[f32], tensor: &mut Tensor) {
    let (height, width) = (tensor.height(), tensor.width());
    let (row, pixel, channels) = (
        tensor.row_stride(),
        tensor.channel_stride(),
        tensor.channels(),
    );
    assert_eq!(
        planes.len(),
        channels * height * width,
        "elements of the image"
    );
    let out = SharedMut::new(tensor.as_mut_slice());
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        // SAFETY: row `y` of every plane and of the tensor, which no other piece writes.
        unsafe {
            isa.run(Interleave {
                from: planes.as_ptr().add(y * width),
                plane: height * width,
                channels,
                count: width,
                to: out.at((y + 1) * row + pixel),
                to_stride: pixel,
                block: pixel,
            });
        }
    });
}

/// Copies a tensor into an image `[channels, height, width]`.
pub(super) fn planes_from_tensor(isa: Isa, tensor: &Tensor, planes: &mut [f32]) {
    let (height, width, channels) = (tensor.height(), tensor.width(), tensor.channels());
    assert_eq!(
        planes.len(),
        channels * height * width,
        "elements of the image"
    );
    let out = SharedMut::new(planes);
    for_each(&mut AlignedBuffer::default(), 0, height, |_, y| {
        // SAFETY: row `y` of the tensor and of every plane, which no other piece writes.
        unsafe {
            isa.run(Separate {
                from: tensor.as_slice().as_ptr().add(tensor.offset(y + 1, 1)),
                from_stride: tensor.channel_stride(),
                to: out.at(y * width),
                plane: height * width,
                channels,
                count: width,
            });
        }
    });
}

/// Channels of the block that starts at `channel`.
pub(super) fn block_channels(channels: usize, channel: usize) -> usize {
    channels.saturating_sub(channel).min(CHANNEL_BLOCK)
}
