//! Numbered tasks on the current rayon pool.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::buffer::AlignedBuffer;

/// Runs `work(scratch, i)` for every `i` below `count`, each worker with `floats` floats of scratch memory of arbitrary
/// contents. Tasks run in any order on any worker, so they must not depend on each other.
pub(crate) fn for_each(
    scratch: &mut AlignedBuffer,
    floats: usize,
    count: usize,
    work: impl Fn(&mut [f32], usize) + Sync,
) {
    let workers = rayon::current_num_threads().min(count);
    // Whole cache lines: no two workers share one.
    let each = floats.next_multiple_of(16);
    let memory = scratch.floats(workers * each);
    if workers <= 1 {
        (0..count).for_each(|i| work(&mut memory[..floats], i));
        return;
    }
    let next = AtomicUsize::new(0);
    let run = |memory: &mut [f32]| {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= count {
                break;
            }
            work(&mut memory[..floats], i);
        }
    };
    if floats == 0 {
        (0..workers)
            .into_par_iter()
            .with_max_len(1)
            .for_each(|_| run(&mut []));
    } else {
        memory
            .par_chunks_exact_mut(each)
            .with_max_len(1)
            .for_each(run);
    }
}

/// A pointer to memory of which several workers write different parts.
#[derive(Clone, Copy)]
pub(crate) struct SharedMut<T = f32>(*mut T);

// SAFETY: it only passes the address on; every access is `unsafe` and must prove that no two workers access the same
// element.
unsafe impl<T> Send for SharedMut<T> {}
// SAFETY: as above.
unsafe impl<T> Sync for SharedMut<T> {}

impl<T> SharedMut<T> {
    pub(crate) fn new(memory: &mut [T]) -> Self {
        Self(memory.as_mut_ptr())
    }

    /// The memory from `offset` on.
    ///
    /// # Safety
    /// `offset` must lie within the memory from which `self` was made.
    pub(crate) unsafe fn moved(self, offset: usize) -> Self {
        // SAFETY: the caller's contract.
        Self(unsafe { self.0.add(offset) })
    }

    /// The address of the element at `offset`.
    ///
    /// # Safety
    /// `offset` must lie within the memory from which `self` was made.
    #[inline(always)]
    pub(crate) unsafe fn at(self, offset: usize) -> *mut T {
        // SAFETY: the caller's contract.
        unsafe { self.0.add(offset) }
    }
}
