//! Scratch memory that is kept between calls.

use std::sync::{Mutex, PoisonError};

use crate::buffer::AlignedBuffer;

/// Scratch memory of a kernel. It grows to what the largest call needs and is then only reused: keep one for each
/// thread that runs a network.
#[derive(Default)]
pub struct Workspace {
    /// What the workers of a call share.
    pub(crate) shared: AlignedBuffer,
    /// What each worker has for itself.
    pub(crate) workers: AlignedBuffer,
}

impl Workspace {
    /// An empty workspace.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }
}

/// Runs `work` with a workspace of a pool that all functions without a workspace argument share. The pool never holds
/// more workspaces than were in use at one time.
pub(crate) fn with_pooled<R>(work: impl FnOnce(&mut Workspace) -> R) -> R {
    static FREE: Mutex<Vec<Workspace>> = Mutex::new(Vec::new());
    // Poisoning says nothing about memory that holds anything.
    let free = || FREE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut workspace = free().pop().unwrap_or_default();
    let result = work(&mut workspace);
    free().push(workspace);
    result
}
