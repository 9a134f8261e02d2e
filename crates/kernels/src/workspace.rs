//! Scratch memory that is kept between calls.

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
