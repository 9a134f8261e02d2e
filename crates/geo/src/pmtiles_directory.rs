//! Header and directories of PMTiles.
//!
//! Specification: PMTiles version 3 (Protomaps): a header of 127 bytes, directories of tile numbers, run lengths,
//! lengths and offsets as variable-length integers, usually compressed.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use flate2::read::GzDecoder;
use grimnet_limits::MapLimits;

/// Bytes of the header.
const HEADER_BYTES: usize = 127;
/// What the file begins with.
pub(crate) const MAGIC: &[u8; 7] = b"PMTiles";
/// The version that is read.
const VERSION: u8 = 3;
/// Directories below directories: the root, leaves, and leaves of leaves.
const MAX_DEPTH: usize = 4;
/// All directories together after decompression, bytes.
const MAX_DIRECTORY_BYTES: u64 = MapLimits::DEFAULT.max_directory_bytes;
/// No compression.
const COMPRESSION_NONE: u8 = 1;
/// Compression by gzip, of directories and tiles.
pub(crate) const COMPRESSION_GZIP: u8 = 2;

/// Why a file cannot be read.
#[derive(Debug)]
pub(crate) enum Problem {
    Io(std::io::Error),
    Damaged(String),
    Truncated { needed_bytes: u64 },
    Unsupported(String, &'static str),
}

impl From<std::io::Error> for Problem {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

fn damaged<T>(reason: impl Into<String>) -> Result<T, Problem> {
    Err(Problem::Damaged(reason.into()))
}

/// A part of the file, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Section {
    pub offset: u64,
    pub length: u64,
}

/// What the header says.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Header {
    root: Section,
    leaves: Section,
    tile_data: Section,
    directory_compression: u8,
    pub tile_compression: u8,
    pub tile_type: u8,
    /// West, south, east and north, degrees.
    pub bounds_deg: [f64; 4],
}

/// Tiles with consecutive numbers that share one picture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    pub first: u64,
    pub count: u32,
    /// Where the picture lies in the file.
    pub data: Section,
}

/// Reads the header, and checks that its sections lie in the file.
pub(crate) fn read_header(file: &mut File) -> Result<Header, Problem> {
    let file_bytes = file.metadata()?.len();
    if file_bytes < HEADER_BYTES as u64 {
        return Err(Problem::Truncated {
            needed_bytes: HEADER_BYTES as u64,
        });
    }
    let mut bytes = [0; HEADER_BYTES];
    file.seek(SeekFrom::Start(0))?;
    file.read_exact(&mut bytes)?;
    if bytes[7] != VERSION {
        return Err(Problem::Unsupported(
            format!("PMTiles version {}", bytes[7]),
            "convert it to version 3: pmtiles convert IN.pmtiles OUT.pmtiles",
        ));
    }
    let number = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]));
    let section = |at: usize| Section {
        offset: number(at),
        length: number(at + 8),
    };
    let degrees =
        |at: usize| f64::from(i32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))) * 1e-7;
    let header = Header {
        root: section(8),
        leaves: section(40),
        tile_data: section(56),
        directory_compression: bytes[97],
        tile_compression: bytes[98],
        tile_type: bytes[99],
        bounds_deg: [degrees(102), degrees(106), degrees(110), degrees(114)],
    };
    for part in [header.root, header.leaves, header.tile_data] {
        let needed_bytes = part.offset.saturating_add(part.length);
        if needed_bytes > file_bytes {
            return Err(Problem::Truncated { needed_bytes });
        }
    }
    Ok(header)
}

/// Reads all directories, in order of tile numbers. No more than `max_tiles` tiles are listed.
pub(crate) fn read_runs(
    file: &mut File,
    header: &Header,
    max_tiles: u64,
) -> Result<Vec<Run>, Problem> {
    let mut reader = DirectoryReader {
        file,
        header,
        runs: Vec::new(),
        tiles_left: max_tiles,
        bytes_left: MAX_DIRECTORY_BYTES,
    };
    reader.add(header.root, 1)?;
    let runs = reader.runs;
    let in_order = runs
        .windows(2)
        .all(|pair| pair[0].first + u64::from(pair[0].count) <= pair[1].first);
    if !in_order {
        return damaged("its directories list tiles twice or out of order");
    }
    Ok(runs)
}

struct DirectoryReader<'a> {
    file: &'a mut File,
    header: &'a Header,
    runs: Vec<Run>,
    tiles_left: u64,
    bytes_left: u64,
}

impl DirectoryReader<'_> {
    fn add(&mut self, section: Section, depth: usize) -> Result<(), Problem> {
        if depth > MAX_DEPTH {
            return damaged(format!(
                "its directories are nested more than {MAX_DEPTH} deep, or in a circle"
            ));
        }
        let entries = entries_of(&self.read(section)?, self.bytes_left)?;
        // They are in memory while the directories below them are read.
        let held_bytes = size_of_val(entries.as_slice()) as u64;
        self.bytes_left -= held_bytes;
        for entry in entries {
            if entry.run_length == 0 {
                let leaf =
                    within(self.header.leaves, entry.offset, entry.length).ok_or_else(|| {
                        Problem::Damaged("a directory lies outside its section".into())
                    })?;
                self.add(leaf, depth + 1)?;
                continue;
            }
            let count = u64::from(entry.run_length);
            if count > self.tiles_left {
                return Err(Problem::Unsupported(
                    "too many tiles".to_string(),
                    "cut out a part: pmtiles extract IN.pmtiles OUT.pmtiles --bbox=W,S,E,N",
                ));
            }
            self.tiles_left -= count;
            if entry.number.checked_add(count).is_none() {
                return damaged("a tile number is beyond the grid");
            }
            let data =
                within(self.header.tile_data, entry.offset, entry.length).ok_or_else(|| {
                    Problem::Damaged("a tile lies outside the section of tiles".into())
                })?;
            self.runs.push(Run {
                first: entry.number,
                count: entry.run_length,
                data,
            });
        }
        self.bytes_left += held_bytes;
        Ok(())
    }

    /// A directory, decompressed.
    fn read(&mut self, section: Section) -> Result<Vec<u8>, Problem> {
        if section.length > self.bytes_left {
            return damaged("its directories are larger than a map can need");
        }
        let stored = read_section(self.file, section)?;
        let mut bytes = Vec::new();
        match self.header.directory_compression {
            COMPRESSION_NONE => bytes = stored,
            COMPRESSION_GZIP => {
                GzDecoder::new(stored.as_slice())
                    .take(self.bytes_left + 1)
                    .read_to_end(&mut bytes)
                    .map_err(|e| {
                        Problem::Damaged(format!("a directory cannot be decompressed: {e}"))
                    })?;
            }
            other => {
                return Err(Problem::Unsupported(
                    format!("directories with compression {other}"),
                    "expected gzip or none: convert it with pmtiles convert",
                ));
            }
        }
        // An empty directory counts too: pointers to it cost time.
        let cost = bytes.len() as u64 + section.length + 1;
        match self.bytes_left.checked_sub(cost) {
            Some(left) => self.bytes_left = left,
            None => return damaged("its directories are larger than a map can need"),
        }
        Ok(bytes)
    }
}

/// Reads a part of the file that was checked to lie in it.
pub(crate) fn read_section(file: &mut File, section: Section) -> Result<Vec<u8>, Problem> {
    file.seek(SeekFrom::Start(section.offset))?;
    let mut bytes = Vec::new();
    file.take(section.length).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < section.length {
        return Err(Problem::Truncated {
            needed_bytes: section.offset + section.length,
        });
    }
    Ok(bytes)
}

fn within(section: Section, offset: u64, length: u32) -> Option<Section> {
    let length = u64::from(length);
    (offset.checked_add(length)? <= section.length).then_some(Section {
        offset: section.offset + offset,
        length,
    })
}

/// An entry of a directory; a run length of 0 points to another directory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Entry {
    number: u64,
    run_length: u32,
    length: u32,
    offset: u64,
}

/// The four columns of a directory; its entries may take so many bytes of memory, six times what they take in the file.
fn entries_of(bytes: &[u8], limit_bytes: u64) -> Result<Vec<Entry>, Problem> {
    let mut rest = bytes;
    let count = varint(&mut rest)?;
    // Each entry takes four bytes at least.
    if count > bytes.len() as u64 / 4 {
        return damaged("a directory has fewer entries than it says");
    }
    if count * size_of::<Entry>() as u64 > limit_bytes {
        return damaged("its directories are larger than a map can need");
    }
    let mut entries = vec![
        Entry {
            number: 0,
            run_length: 0,
            length: 0,
            offset: 0
        };
        count as usize
    ];
    let mut number = 0_u64;
    for entry in &mut entries {
        let step = varint(&mut rest)?;
        number = match number.checked_add(step) {
            Some(number) => number,
            None => return damaged("a tile number is beyond the grid"),
        };
        entry.number = number;
    }
    let short = |value: u64| {
        u32::try_from(value).map_err(|_| Problem::Damaged("a length has more than 32 bits".into()))
    };
    for entry in &mut entries {
        entry.run_length = short(varint(&mut rest)?)?;
    }
    for entry in &mut entries {
        entry.length = short(varint(&mut rest)?)?;
    }
    let mut after_previous = None;
    for entry in &mut entries {
        entry.offset = match (varint(&mut rest)?, after_previous) {
            (0, Some(offset)) => offset,
            (0, None) => return damaged("the first entry of a directory has no offset"),
            (value, _) => value - 1,
        };
        after_previous = entry.offset.checked_add(u64::from(entry.length));
        if after_previous.is_none() {
            return damaged("an offset is beyond the file");
        }
    }
    Ok(entries)
}

/// An unsigned integer of seven bits a byte, the low ones first.
fn varint(rest: &mut &[u8]) -> Result<u64, Problem> {
    let mut value = 0_u64;
    for shift in (0..64).step_by(7) {
        let Some((&byte, after)) = rest.split_first() else {
            return damaged("a directory ends too early");
        };
        *rest = after;
        let bits = u64::from(byte & 0x7f);
        if shift == 63 && bits > 1 {
            break;
        }
        value |= bits << shift;
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    damaged("a number has more than 64 bits")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_count_with_the_memory_that_they_take() {
        // A thousand tiles of one byte each, one after the other: count, then steps, run lengths, lengths and offsets.
        let mut bytes = vec![0xe8, 0x07];
        bytes.extend(vec![1; 3000]);
        bytes.push(1);
        bytes.extend(vec![0; 999]);
        let needed_bytes = 1000 * size_of::<Entry>() as u64;
        let entries = entries_of(&bytes, needed_bytes).unwrap();
        assert_eq!(entries.len(), 1000);
        assert_eq!((entries[999].number, entries[999].offset), (1000, 999));
        let problem = entries_of(&bytes, needed_bytes - 1).unwrap_err();
        assert!(matches!(problem, Problem::Damaged(text) if text.contains("larger")));
    }
}
