//! Numbers in the first directory of a TIFF file.

/// TIFF 6.0, NewSubfileType; bit 0: another picture of the file in less pixels.
const NEW_SUBFILE_TYPE: u16 = 254;
const REDUCED: u32 = 1;
/// TIFF 6.0, SubfileType (old); 2: the same.
const SUBFILE_TYPE: u16 = 255;
const OLD_REDUCED: u32 = 2;
/// DNG 1.0, DNGVersion.
const DNG_VERSION: u16 = 50706;
/// What Canon's raw files (CR2) have at byte 8.
const CR2: &[u8] = b"CR";

/// Why the first picture of a TIFF file is not the photo; `None` if it is. Decoders give the first one only.
pub(crate) fn why_not_the_photo(bytes: &[u8]) -> Option<&'static str> {
    let has = |tag| directory_number(bytes, tag);
    if has(DNG_VERSION).is_some() || bytes.get(8..10) == Some(CR2) {
        return Some("a raw photo, of which only a thumbnail could be read");
    }
    let is_reduced = has(NEW_SUBFILE_TYPE).is_some_and(|flags| flags & REDUCED != 0)
        || has(SUBFILE_TYPE) == Some(OLD_REDUCED);
    is_reduced.then_some(
        "its first picture is a thumbnail, and only the first picture of a TIFF file is read",
    )
}

/// The first number of an entry, as far as it is in the entry itself: up to four bytes of them, of type BYTE, SHORT or LONG.
fn directory_number(bytes: &[u8], tag: u16) -> Option<u32> {
    let is_little = bytes.starts_with(b"II");
    let at = |at: usize, length: usize| -> Option<u32> {
        let bytes = bytes.get(at..at.checked_add(length)?)?;
        let add = |number: u32, byte: &u8| number << 8 | u32::from(*byte);
        Some(if is_little {
            bytes.iter().rev().fold(0, add)
        } else {
            bytes.iter().fold(0, add)
        })
    };
    let directory = at(4, 4)? as usize;
    let count = at(directory, 2)? as usize;
    let entry = (0..count)
        .map(|index| directory.saturating_add(2 + 12 * index))
        .take_while(|entry| *entry < bytes.len())
        .find(|entry| at(*entry, 2) == Some(u32::from(tag)))?;
    // Types of TIFF 6.0.
    match at(entry + 2, 2)? {
        1 => at(entry + 8, 1),
        3 => at(entry + 8, 2),
        4 => at(entry + 8, 4),
        _ => None,
    }
}
