//! Compares a whole pack file with its checksums.

use crate::error::{PackError, Result};
use crate::feature_store::check_blocks;
use crate::format::{BLOCK_LEN, blocks_name};
use crate::layout::{check_places, copy_section, read_manifest};
use crate::pack::Pack;
use grimnet_limits::PackLimits;

/// Bytes that are read and checked at a time.
const STEP_LEN: u64 = 64 * BLOCK_LEN;

/// How far [`Pack::verify`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VerifyProgress {
    /// Bytes of sections that are checked.
    pub done_bytes: u64,
    /// Bytes of all sections.
    pub total_bytes: u64,
}

impl Pack {
    /// Reads the whole file again and compares every byte with its checksum, features included, whatever was compared
    /// on opening. `on_progress` is called after each section and every 64 MiB.
    ///
    /// # Errors
    /// Returns [`PackError::Corrupt`] with the first section that differs, [`PackError::Truncated`] or
    /// [`PackError::Changed`] if the file has another length than on opening.
    pub fn verify(&self, on_progress: &mut dyn FnMut(VerifyProgress)) -> Result<()> {
        let file = self.file();
        file.check_unchanged()?;
        let manifest = read_manifest(file)?;
        if manifest != *self.manifest() {
            return Err(PackError::corrupt(
                self.path(),
                "manifest: differs from the one that was opened",
            ));
        }
        check_places(file, &manifest, &PackLimits::default())?;
        let mut progress = VerifyProgress {
            done_bytes: 0,
            total_bytes: manifest.sections.iter().map(|s| s.len).sum(),
        };
        for section in &manifest.sections {
            if section.block_len.is_none() {
                copy_section(file, section)?;
                progress.done_bytes += section.len;
                on_progress(progress);
                continue;
            }
            let hashes = manifest.section(&blocks_name(&section.name));
            let hashes = match hashes {
                Some(hashes) if hashes.blake3 == section.blake3 => copy_section(file, hashes)?,
                _ => return Err(PackError::corrupt(self.path(), "block hashes are missing")),
            };
            let mut done = 0;
            while done < section.len {
                let len = STEP_LEN.min(section.len - done);
                let bytes = file.copy(section.offset + done, len)?;
                let first = (done / BLOCK_LEN) as usize;
                check_blocks(file, section, first, bytes.as_slice(), hashes.as_slice())?;
                done += len;
                progress.done_bytes += len;
                on_progress(progress);
            }
        }
        Ok(())
    }
}
