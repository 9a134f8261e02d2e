//! Writes a pack: sections one after the other, then the manifest, then the header.

use std::io::{BufWriter, Read as _, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use fs_err::File;

use crate::error::{PackError, Result};
use crate::format::{ALIGNMENT, BLOCK_LEN, FORMAT_VERSION, HEADER_LEN, Header, MAGIC, blocks_name};
use crate::manifest::{Manifest, Section};

/// Bytes gathered before they go to the system.
const BUFFER_LEN: usize = 1 << 20;

/// Writes the sections of a pack in order. The file is no pack before [`Writer::finish`].
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    file: BufWriter<File>,
    position: u64,
    sections: Vec<Section>,
    open: Option<OpenSection>,
}

#[derive(Debug)]
struct OpenSection {
    name: String,
    offset: u64,
    checksum: Checksum,
}

#[derive(Debug)]
enum Checksum {
    /// Of the whole section.
    Whole(blake3::Hasher),
    /// Of each block.
    Blocks {
        block: blake3::Hasher,
        block_bytes: u64,
        hashes: Vec<u8>,
    },
}

impl Checksum {
    fn update(&mut self, mut bytes: &[u8]) {
        match self {
            Self::Whole(hasher) => {
                hasher.update(bytes);
            }
            Self::Blocks {
                block,
                block_bytes,
                hashes,
            } => {
                while !bytes.is_empty() {
                    let room = (BLOCK_LEN - *block_bytes).min(bytes.len() as u64);
                    let (now, rest) = bytes.split_at(room as usize);
                    block.update(now);
                    *block_bytes += room;
                    bytes = rest;
                    if *block_bytes == BLOCK_LEN {
                        hashes.extend_from_slice(block.finalize().as_bytes());
                        block.reset();
                        *block_bytes = 0;
                    }
                }
            }
        }
    }
}

/// Removes what a killed build left of a pack: a file that is empty, or starts with the place of the header or with a
/// header. Only the name goes, a hard link elsewhere keeps its content.
///
/// # Errors
/// Returns [`PackError::InTheWay`] for anything else, and [`PackError::Io`] for errors of the system.
pub(crate) fn clear_unfinished(path: &Path) -> Result<()> {
    let metadata = match std::fs::symlink_metadata(path) {
        Ok(metadata) => metadata,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(e) => return Err(PackError::io("examine", path, e)),
    };
    let in_the_way = |why| PackError::InTheWay {
        path: path.to_path_buf(),
        why,
    };
    if !metadata.is_file() {
        return Err(in_the_way("it is a link, a folder or a device"));
    }
    let mut head = Vec::new();
    File::open(path)
        .and_then(|file| file.take(HEADER_LEN).read_to_end(&mut head))
        .map_err(|e| PackError::io("read", path, e))?;
    if !head.starts_with(&MAGIC) && head.iter().any(|&byte| byte != 0) {
        return Err(in_the_way("it is not an unfinished pack"));
    }
    fs_err::remove_file(path).map_err(|e| PackError::io("delete", path, e))
}

impl Writer {
    /// Starts a file, replacing what is there.
    ///
    /// # Errors
    /// Returns an error if the file cannot be created or written.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|e| PackError::io("create", path, e))?;
        Self::start(path, file)
    }

    /// Starts a working file of a build, where nothing may stand; see [`clear_unfinished`].
    pub(crate) fn create_new(path: &Path) -> Result<Self> {
        let file = File::create_new(path).map_err(|e| PackError::io("create", path, e))?;
        Self::start(path, file)
    }

    fn start(path: &Path, file: File) -> Result<Self> {
        let mut writer = Self {
            path: path.to_path_buf(),
            file: BufWriter::with_capacity(BUFFER_LEN, file),
            position: 0,
            sections: Vec::new(),
            open: None,
        };
        writer.put(&[0; HEADER_LEN as usize])?;
        Ok(writer)
    }

    /// Ends the current section, if any, and starts one called `name`.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn begin(&mut self, name: impl Into<String>) -> Result<()> {
        self.begin_with(name.into(), Checksum::Whole(blake3::Hasher::new()))
    }

    /// As [`Writer::begin`], for a section that is hashed in blocks; section `NAME.blocks` is written after it.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn begin_blocks(&mut self, name: impl Into<String>) -> Result<()> {
        let checksum = Checksum::Blocks {
            block: blake3::Hasher::new(),
            block_bytes: 0,
            hashes: Vec::new(),
        };
        self.begin_with(name.into(), checksum)
    }

    fn begin_with(&mut self, name: String, checksum: Checksum) -> Result<()> {
        self.end()?;
        self.pad()?;
        self.open = Some(OpenSection {
            name,
            offset: self.position,
            checksum,
        });
        Ok(())
    }

    /// Appends to the current section.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        if let Some(open) = &mut self.open {
            open.checksum.update(bytes);
        }
        self.put(bytes)
    }

    /// Writes a whole section.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn section(&mut self, name: impl Into<String>, bytes: &[u8]) -> Result<()> {
        self.begin(name)?;
        self.write(bytes)?;
        self.end()
    }

    /// Bytes written to the current section so far.
    pub fn section_len(&self) -> u64 {
        self.open
            .as_ref()
            .map_or(0, |open| self.position - open.offset)
    }

    /// Writes the manifest (its list of sections is filled in here) and the header, and waits for the disk.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn finish(mut self, mut manifest: Manifest) -> Result<()> {
        self.end()?;
        self.pad()?;
        manifest.sections = std::mem::take(&mut self.sections);
        manifest.format_version = FORMAT_VERSION;
        let json = serde_json::to_vec(&manifest).map_err(|e| {
            PackError::Options(format!("the manifest cannot be written as JSON: {e}"))
        })?;
        let header = Header {
            magic: MAGIC,
            version: FORMAT_VERSION,
            reserved: 0,
            manifest_offset: self.position,
            manifest_len: json.len() as u64,
            manifest_blake3: *blake3::hash(&json).as_bytes(),
        };
        self.put(&json)?;
        let path = self.path;
        let error = |e| PackError::io("write", &path, e);
        self.file.seek(SeekFrom::Start(0)).map_err(error)?;
        self.file
            .write_all(bytemuck::bytes_of(&header))
            .map_err(error)?;
        let file = self.file.into_inner().map_err(|e| error(e.into_error()))?;
        file.sync_all().map_err(error)
    }

    fn end(&mut self) -> Result<()> {
        let Some(open) = self.open.take() else {
            return Ok(());
        };
        let len = self.position - open.offset;
        let (hash, blocks) = match open.checksum {
            Checksum::Whole(hasher) => (hasher.finalize(), None),
            Checksum::Blocks {
                block,
                block_bytes,
                mut hashes,
            } => {
                if block_bytes > 0 {
                    hashes.extend_from_slice(block.finalize().as_bytes());
                }
                (blake3::hash(&hashes), Some(hashes))
            }
        };
        let name = open.name.clone();
        self.sections.push(Section {
            name: open.name,
            offset: open.offset,
            len,
            blake3: hash.to_hex().to_string(),
            block_len: blocks.is_some().then_some(BLOCK_LEN),
        });
        match blocks {
            Some(hashes) => self.section(blocks_name(&name), &hashes),
            None => Ok(()),
        }
    }

    fn pad(&mut self) -> Result<()> {
        let gap = (self.position.next_multiple_of(ALIGNMENT) - self.position) as usize;
        self.put(&[0; ALIGNMENT as usize][..gap])
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.file
            .write_all(bytes)
            .map_err(|e| PackError::io("write", &self.path, e))?;
        self.position += bytes.len() as u64;
        Ok(())
    }
}
