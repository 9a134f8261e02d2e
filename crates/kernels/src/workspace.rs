//! Scratch memory that is reused between calls.

use std::sync::{Mutex, PoisonError};

use crate::buffer::AlignedBuffer;

/// Scratch memory of the kernels. It grows to the size that the largest call needs and is reused afterwards: keep one for
/// each thread that runs a network.
#[derive(Default)]
pub struct Workspace {
    /// Memory that the workers of a call share.
    pub(crate) shared: AlignedBuffer,
    /// Memory of each worker.
    pub(crate) workers: AlignedBuffer,
}

impl Workspace {
    /// An empty workspace.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

/// Runs `work` with a workspace from a pool, which all functions without a workspace argument share. The pool never holds
/// more workspaces than were in use at the same time.
pub(crate) fn with_pooled<R>(work: impl FnOnce(&mut Workspace) -> R) -> R {
    static FREE: Mutex<Vec<Workspace>> = Mutex::new(Vec::new());
    // The contents of a workspace are arbitrary, so a poisoned lock does no harm.
    let free = || FREE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut workspace = free().pop().unwrap_or_default();
    let result = work(&mut workspace);
    free().push(workspace);
    result
}
