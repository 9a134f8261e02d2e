//! The entries of a ZIP file that are stored uncompressed, as PyTorch writes all of them.

use std::collections::HashMap;

const END: u32 = 0x0605_4b50;
const ENTRY: u32 = 0x0201_4b50;
/// A comment after the end record makes it start at most this early.
const LONGEST_END: usize = 65_557;

fn u16_at(bytes: &[u8], at: usize) -> Option<usize> {
    let b = bytes.get(at..at + 2)?;
    Some(usize::from(u16::from_le_bytes([b[0], b[1]])))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let b = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

/// Name and content of each stored entry; `None` where this is no ZIP file.
pub(super) fn stored_entries(bytes: &[u8]) -> Option<HashMap<String, &[u8]>> {
    let first = bytes.len().saturating_sub(LONGEST_END);
    let end = (first..bytes.len().saturating_sub(21))
        .rev()
        .find(|at| u32_at(bytes, *at) == Some(END))?;
    let count = u16_at(bytes, end + 10)?;
    let mut at = u32_at(bytes, end + 16)? as usize;
    let mut out = HashMap::new();
    for _ in 0..count {
        if u32_at(bytes, at)? != ENTRY {
            return None;
        }
        let (method, size) = (u16_at(bytes, at + 10)?, u32_at(bytes, at + 24)? as usize);
        let [name, extra, comment] = [28, 30, 32].map(|field| u16_at(bytes, at + field));
        let (name, extra, comment) = (name?, extra?, comment?);
        let local = u32_at(bytes, at + 42)? as usize;
        let title = String::from_utf8_lossy(bytes.get(at + 46..at + 46 + name)?).into_owned();
        if method == 0 {
            let start = local + 30 + u16_at(bytes, local + 26)? + u16_at(bytes, local + 28)?;
            out.insert(title, bytes.get(start..start.checked_add(size)?)?);
        }
        at += 46 + name + extra + comment;
    }
    Some(out)
}
