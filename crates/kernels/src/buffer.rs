//! Heap memory of `f32` aligned to cache lines, so that aligned vector loads do not cross two of them.

use bytemuck::{Pod, Zeroable};

const FLOATS_PER_LINE: usize = 16;

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct CacheLine([f32; FLOATS_PER_LINE]);

/// A growable buffer of `f32`, initialised with zeros, that starts on a cache line.
#[derive(Clone, Default)]
pub(crate) struct AlignedBuffer {
    lines: Vec<CacheLine>,
}

impl AlignedBuffer {
    pub(crate) fn zeroed(floats: usize) -> Self {
        Self {
            lines: vec![CacheLine::zeroed(); floats.div_ceil(FLOATS_PER_LINE)],
        }
    }

    /// `count` floats of arbitrary contents. The memory grows if necessary and never shrinks.
    pub(crate) fn floats(&mut self, count: usize) -> &mut [f32] {
        self.grow(count);
        &mut self.as_mut_slice()[..count]
    }

    /// Makes room for at least `floats` floats and keeps the contents; never shrinks.
    pub(crate) fn grow(&mut self, floats: usize) {
        let lines = floats.div_ceil(FLOATS_PER_LINE);
        if lines > self.lines.len() {
            self.lines.resize(lines, CacheLine::zeroed());
        }
    }

    pub(crate) fn as_slice(&self) -> &[f32] {
        bytemuck::cast_slice(&self.lines)
    }

    pub(crate) fn as_mut_slice(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.lines)
    }
}
