//! Where the parts of a pack file lie: header, manifest and sections.

use crate::error::{PackError, Result};
use crate::file::{AlignedBytes, PackFile};
use crate::format::{
    ALIGNMENT, BLOCK_LEN, FORMAT_VERSION, HEADER_LEN, Header, MAGIC, MAX_MANIFEST_LEN,
};
use crate::manifest::{Manifest, Section};
use grimnet_limits::PackLimits;

/// Reads header and manifest.
///
/// # Errors
/// Returns an error if the file is not a pack, has another format version, is truncated or damaged.
pub(crate) fn read_manifest(file: &PackFile) -> Result<Manifest> {
    let path = file.path();
    let truncated = |expected| PackError::Truncated {
        path: path.to_path_buf(),
        expected,
        found: file.len(),
    };
    if file.len() == 0 {
        return Err(truncated(HEADER_LEN));
    }
    let mut start = [0; HEADER_LEN as usize];
    let head = &mut start[..file.len().min(HEADER_LEN) as usize];
    file.read_exact_at(head, 0)?;
    if !head.starts_with(&MAGIC) {
        return Err(PackError::NotAPack {
            path: path.to_path_buf(),
        });
    }
    if file.len() < HEADER_LEN {
        return Err(truncated(HEADER_LEN));
    }
    let header: Header = bytemuck::pod_read_unaligned(&start);
    if header.version != FORMAT_VERSION {
        return Err(PackError::Version {
            path: path.to_path_buf(),
            found: header.version,
            supported: FORMAT_VERSION,
        });
    }
    let end = header
        .manifest_offset
        .checked_add(header.manifest_len)
        .ok_or_else(|| PackError::corrupt(path, "header: lengths out of range"))?;
    if end > file.len() {
        return Err(truncated(end));
    }
    if end < file.len() || header.manifest_offset < HEADER_LEN || header.reserved != 0 {
        return Err(PackError::corrupt(
            path,
            "header: the file is longer than its contents",
        ));
    }
    if header.manifest_len > MAX_MANIFEST_LEN {
        return Err(PackError::corrupt(
            path,
            format!(
                "manifest: {} bytes, more than {MAX_MANIFEST_LEN}",
                header.manifest_len
            ),
        ));
    }
    let json = file.copy(header.manifest_offset, header.manifest_len)?;
    if blake3::hash(json.as_slice()).as_bytes() != &header.manifest_blake3 {
        return Err(PackError::corrupt(path, "manifest: checksum differs"));
    }
    serde_json::from_slice(json.as_slice())
        .map_err(|e| PackError::corrupt(path, format!("manifest: not readable ({e})")))
}

/// Checks that sections lie one after the other with nothing but zeros between them.
///
/// # Errors
/// Returns an error if they do not, or if the sections that are copied into memory exceed the limit.
pub(crate) fn check_places(
    file: &PackFile,
    manifest: &Manifest,
    limits: &PackLimits,
) -> Result<()> {
    let path = file.path();
    let mut end = HEADER_LEN;
    let mut table_bytes = 0u64;
    for Section {
        name,
        offset,
        len,
        block_len,
        ..
    } in &manifest.sections
    {
        let wrong = |what: &str| {
            let name = name.escape_debug();
            Err(PackError::corrupt(path, format!("section {name}: {what}")))
        };
        let next = offset.checked_add(*len).filter(|next| *next <= file.len());
        let (Some(next), true) = (next, *offset == end.next_multiple_of(ALIGNMENT)) else {
            return wrong("offset or length out of range");
        };
        if !is_zero(file, end, *offset)? {
            return wrong("padding differs");
        }
        match block_len {
            None => table_bytes = table_bytes.saturating_add(*len),
            Some(block) if *block == BLOCK_LEN => {}
            Some(_) => return wrong("unknown block length"),
        }
        end = next;
    }
    let tail = end.next_multiple_of(ALIGNMENT).min(file.len());
    if !is_zero(file, end, tail)? {
        return Err(PackError::corrupt(path, "padding differs"));
    }
    if table_bytes > limits.max_table_bytes {
        return Err(PackError::TooLarge {
            path: path.to_path_buf(),
            what: "tables",
            found: table_bytes,
            limit: limits.max_table_bytes,
        });
    }
    Ok(())
}

/// Whether the bytes between two offsets, at most a line of [`ALIGNMENT`], are zero.
fn is_zero(file: &PackFile, from: u64, to: u64) -> Result<bool> {
    let mut bytes = [0; ALIGNMENT as usize];
    let bytes = &mut bytes[..(to - from).min(ALIGNMENT) as usize];
    file.read_exact_at(bytes, from)?;
    Ok(bytes.iter().all(|&b| b == 0))
}

/// Copies a section without blocks into memory and compares it with its checksum.
///
/// # Errors
/// Returns an error if the file cannot be read or the checksum differs.
pub(crate) fn copy_section(file: &PackFile, section: &Section) -> Result<AlignedBytes> {
    let bytes = file.copy(section.offset, section.len)?;
    let mut hasher = blake3::Hasher::new();
    hasher.update_rayon(bytes.as_slice());
    if hasher.finalize().to_hex().as_str() == section.blake3 {
        return Ok(bytes);
    }
    Err(PackError::corrupt(
        file.path(),
        format!("section {}: checksum differs", section.name.escape_debug()),
    ))
}
