//! Arrays of an `.npz` file, NumPy's zip of `.npy` files.

use std::io::{self, BufReader, Read};
use std::path::Path;

use fs_err::File;
use zip::ZipArchive;
use zip::result::ZipError;

use crate::npy::{self, Array};

/// Largest array that is read: no file can make us take all memory.
const MAX_BYTES: u64 = 1 << 30;

/// An open file.
pub struct Npz {
    archive: ZipArchive<BufReader<File>>,
}

impl Npz {
    /// Opens a file.
    ///
    /// # Errors
    /// It cannot be read, or is no zip.
    pub fn open(path: &Path) -> io::Result<Self> {
        Ok(Self {
            archive: ZipArchive::new(BufReader::new(File::open(path)?))?,
        })
    }

    /// An array of floating point numbers, whichever width they are stored in.
    ///
    /// # Errors
    /// There is none of that name, it is damaged or holds something else.
    pub fn floats(&mut self, name: &str) -> io::Result<Array<f64>> {
        self.read(name, npy::floats)
    }

    /// An array of bytes, such as a picture.
    ///
    /// # Errors
    /// As [`Npz::floats`].
    pub fn bytes(&mut self, name: &str) -> io::Result<Array<u8>> {
        self.read(name, npy::bytes)
    }

    fn read<T>(
        &mut self,
        name: &str,
        parse: impl FnOnce(&[u8]) -> io::Result<Array<T>>,
    ) -> io::Result<Array<T>> {
        self.member(name)
            .and_then(|bytes| parse(&bytes))
            .map_err(|error| io::Error::new(error.kind(), format!("`{name}` {error}")))
    }

    fn member(&mut self, name: &str) -> io::Result<Vec<u8>> {
        let member = self.archive.by_name(&format!("{name}.npy"));
        let member = member.map_err(|error| match error {
            ZipError::FileNotFound => io::Error::new(io::ErrorKind::NotFound, "is not there"),
            other => other.into(),
        })?;
        let mut bytes = Vec::new();
        member.take(MAX_BYTES).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_archive_or_not_in_it_is_named() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/anyvisloc/Scene_07");
        assert!(Npz::open(&golden.join("L07_reference.json")).is_err());
        let mut npz = Npz::open(&golden.join("L07_0001.npz")).unwrap();
        let error = npz.floats("nothing").err().unwrap().to_string();
        assert_eq!(error, "`nothing` is not there");
        assert!(npz.bytes("xyz").is_err(), "numbers are no bytes");
        assert_eq!(npz.floats("K").unwrap().shape, [3, 3]);
    }
}
