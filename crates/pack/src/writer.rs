//! Writes a pack: sections one after the other, then the manifest, then the header.

use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use fs_err::File;

use crate::error::{PackError, Result};
use crate::format::{ALIGNMENT, FORMAT_VERSION, HEADER_LEN, Header, MAGIC};
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
    hasher: blake3::Hasher,
}

impl Writer {
    /// Starts a file, replacing what is there.
    ///
    /// # Errors
    /// Where the file cannot be made or written.
    pub fn create(path: &Path) -> Result<Self> {
        let file = File::create(path).map_err(|e| PackError::io("create", path, e))?;
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
    /// Where the file cannot be written.
    pub fn begin(&mut self, name: impl Into<String>) -> Result<()> {
        self.end()?;
        self.pad()?;
        self.open = Some(OpenSection {
            name: name.into(),
            offset: self.position,
            hasher: blake3::Hasher::new(),
        });
        Ok(())
    }

    /// Appends to the current section.
    ///
    /// # Errors
    /// Where the file cannot be written.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        if let Some(open) = &mut self.open {
            open.hasher.update(bytes);
        }
        self.put(bytes)
    }

    /// Writes a whole section.
    ///
    /// # Errors
    /// Where the file cannot be written.
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
    /// Where the file cannot be written.
    pub fn finish(mut self, mut manifest: Manifest) -> Result<Manifest> {
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
        file.sync_all().map_err(error)?;
        Ok(manifest)
    }

    fn end(&mut self) -> Result<()> {
        if let Some(open) = self.open.take() {
            self.sections.push(Section {
                name: open.name,
                offset: open.offset,
                len: self.position - open.offset,
                blake3: open.hasher.finalize().to_hex().to_string(),
            });
        }
        Ok(())
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
