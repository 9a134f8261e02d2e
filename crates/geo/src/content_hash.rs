//! The hash of a map's content.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::GeoError;

/// Bytes read at a time.
const CHUNK_BYTES: usize = 1 << 20;

/// Values that belong to a map's content besides the bytes of its files: what a map takes from files that other programs
/// rewrite, such as `.aux.xml` when they compute statistics.
#[derive(Debug, Default)]
pub(crate) struct ContentValues(Vec<u8>);

impl ContentValues {
    /// Adds numbers.
    pub fn add_numbers(&mut self, name: &str, numbers: &[f64]) {
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.add(name, &bytes);
    }

    /// Adds a text.
    pub fn add_text(&mut self, name: &str, text: &str) {
        self.add(name, text.as_bytes());
    }

    fn add(&mut self, name: &str, bytes: &[u8]) {
        for part in [name.as_bytes(), bytes] {
            self.0.extend((part.len() as u64).to_le_bytes());
            self.0.extend(part);
        }
    }
}

/// BLAKE3 over the content of a map, computed on first use.
#[derive(Debug, Default)]
pub(crate) struct ContentHash {
    files: Vec<PathBuf>,
    values: ContentValues,
    hash: OnceLock<[u8; 32]>,
}

impl ContentHash {
    /// Of these files, in this order. One file alone has the hash that `b3sum` prints.
    pub fn of(files: Vec<PathBuf>) -> Self {
        Self {
            files,
            ..Self::default()
        }
    }

    /// With these values besides; none leave the hash as it is.
    pub fn with_values(self, values: ContentValues) -> Self {
        Self { values, ..self }
    }

    /// The files.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// The hash.
    pub fn get(&self) -> Result<[u8; 32], GeoError> {
        if let Some(hash) = self.hash.get() {
            return Ok(*hash);
        }
        let hash = self.of_now()?;
        Ok(*self.hash.get_or_init(|| hash))
    }

    /// The hash of what the files hold now, and of the values as they were read.
    pub fn of_now(&self) -> Result<[u8; 32], GeoError> {
        let mut hasher = blake3::Hasher::new();
        for (i, file) in self.files.iter().enumerate() {
            let length = hash_file(&mut hasher, file)?;
            if i > 0 {
                // Marks where a file ends, so that bytes cannot move from one to the next.
                hasher.update(&length.to_le_bytes());
            }
        }
        let values = &self.values.0;
        if !values.is_empty() {
            hasher.update(values);
            hasher.update(&(values.len() as u64).to_le_bytes());
        }
        Ok(hasher.finalize().into())
    }
}

/// Adds the bytes of a file to a hash. Returns their number.
pub(crate) fn hash_file(hasher: &mut blake3::Hasher, path: &Path) -> Result<u64, GeoError> {
    let mut file = std::fs::File::open(path).map_err(|e| GeoError::io(path, e))?;
    let mut buffer = vec![0_u8; CHUNK_BYTES];
    let mut length = 0_u64;
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok(length),
            Ok(n) => {
                hasher.update(&buffer[..n]);
                length += n as u64;
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(GeoError::io(path, e)),
        }
    }
}
