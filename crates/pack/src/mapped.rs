//! The mapped bytes of a file.

use memmap2::Mmap;

/// The mapped bytes of a file.
#[derive(Debug)]
pub(crate) struct Mapped(pub(crate) Mmap);

impl Mapped {
    /// Bytes of a section; its bounds were checked on opening.
    pub(crate) fn section(&self, offset: u64, len: u64) -> &[u8] {
        &self.0[offset as usize..(offset + len) as usize]
    }
}
