//! The file of a pack: parts are copied into memory or mapped.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use bytemuck::Pod;
use fs_err::File;
use memmap2::Mmap;

use crate::error::{PackError, Result};

/// An open pack file.
#[derive(Debug)]
pub(crate) struct PackFile {
    path: PathBuf,
    file: File,
    len: u64,
    /// Time of the last modification when it was opened.
    modified: Option<SystemTime>,
}

impl PackFile {
    /// Opens a regular file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be opened or is a folder or device.
    pub fn open(path: &Path) -> Result<Self> {
        let error = |e| PackError::io("open", path, e);
        // Opening a FIFO would wait for a writer, so the kind is examined first.
        if !std::fs::metadata(path).map_err(error)?.is_file() {
            return Err(PackError::NotAPack {
                path: path.to_path_buf(),
            });
        }
        let file = File::open(path).map_err(error)?;
        let metadata = file.metadata().map_err(error)?;
        Ok(Self {
            path: path.to_path_buf(),
            file,
            len: metadata.len(),
            modified: metadata.modified().ok(),
        })
    }

    /// The path it was opened by.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of the file when it was opened.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Time of the last modification when it was opened, if the system tells it.
    pub fn modified(&self) -> Option<SystemTime> {
        self.modified
    }

    /// Checks that the file still has the length it was opened with. Returns the time of its last modification, if the system
    /// tells it.
    ///
    /// # Errors
    /// Returns [`PackError::Changed`] if the length differs.
    pub fn check_unchanged(&self) -> Result<Option<SystemTime>> {
        let metadata = self
            .file
            .metadata()
            .map_err(|e| PackError::io("read", &self.path, e))?;
        if metadata.len() != self.len {
            return Err(PackError::Changed {
                path: self.path.clone(),
                expected: self.len,
                found: metadata.len(),
            });
        }
        Ok(metadata.modified().ok())
    }

    /// Copies `len` bytes from `offset` on.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or ends before.
    pub fn copy(&self, offset: u64, len: u64) -> Result<AlignedBytes> {
        let mut copied = AlignedBytes::zeroed(len as usize);
        self.read_exact_at(copied.as_mut_slice(), offset)?;
        Ok(copied)
    }

    /// Reads bytes from `offset` on.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or ends before.
    pub fn read_exact_at(&self, into: &mut [u8], offset: u64) -> Result<()> {
        read_exact_at(self.file.file(), into, offset).map_err(|e| {
            if e.kind() == std::io::ErrorKind::UnexpectedEof {
                PackError::Truncated {
                    path: self.path.clone(),
                    expected: offset.saturating_add(into.len() as u64),
                    found: self.file.metadata().map_or(0, |m| m.len()),
                }
            } else {
                PackError::io("read", &self.path, e)
            }
        })
    }

    /// Maps the whole file into memory.
    ///
    /// # Errors
    /// Returns an error if the system cannot map it.
    pub fn map(&self) -> Result<Mmap> {
        // SAFETY: the mapping is read-only, and nothing in this process writes to the file. Packs are never changed in
        // place by the builder, which writes a new file and renames it: the mapped one stays as it is. Another program
        // may still truncate the file: `check_unchanged` is called before each use, which leaves a moment in which a
        // truncation ends the process with the system's bus error (SECURITY.md). The bytes are only ever read as
        // numbers, for which every value is valid.
        #[allow(unsafe_code)]
        let map = unsafe { Mmap::map(self.file.file()) };
        map.map_err(|e| PackError::io("map into memory", &self.path, e))
    }
}

#[cfg(unix)]
fn read_exact_at(file: &std::fs::File, into: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, into, offset)
}

#[cfg(windows)]
fn read_exact_at(
    file: &std::fs::File,
    mut into: &mut [u8],
    mut offset: u64,
) -> std::io::Result<()> {
    while !into.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, into, offset) {
            Ok(0) => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                into = &mut into[n..];
                offset += n as u64;
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Bytes at an address that is a multiple of 8, so that they can be viewed as numbers.
#[derive(Clone, Debug, Default)]
pub(crate) struct AlignedBytes {
    words: Vec<u64>,
    len: usize,
}

impl AlignedBytes {
    fn zeroed(len: usize) -> Self {
        Self {
            words: vec![0; len.div_ceil(8)],
            len,
        }
    }

    pub fn as_slice(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.len]
    }

    fn as_mut_slice(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.len]
    }

    /// The bytes as numbers; empty if their length is not a multiple of the size of `T`.
    pub fn numbers<T: Pod>(&self) -> &[T] {
        bytemuck::try_cast_slice(self.as_slice()).unwrap_or_default()
    }
}
