//! Arrays of an `.npz` file: NumPy's zip archive of `.npy` arrays.
//!
//! Every size that a file declares is checked against a limit before memory is allocated for it, so that a small compressed file
//! cannot claim all memory.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use fs_err::File;
use grimnet_limits::ArrayLimits;
use npyz::{DType, NpyFile, Order, TypeChar};
use zip::ZipArchive;
use zip::result::ZipError;

/// An array: its values in C order, and its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Array<T> {
    /// The values, the last axis running fastest.
    pub values: Vec<T>,
    /// Length of each axis; empty for a scalar.
    pub shape: Vec<usize>,
}

/// Why an array cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NpzError {
    /// The file cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The file is not a zip archive, or is damaged.
    #[error("{path}: not a readable .npz archive: {source}")]
    Archive {
        /// The file.
        path: PathBuf,
        /// The reader's error.
        source: ZipError,
    },
    /// The archive has no array of this name.
    #[error("no array `{name}` in the archive")]
    Missing {
        /// Name of the array.
        name: String,
    },
    /// The array is not in `.npy` format, or is damaged.
    #[error("array `{name}`: not a readable .npy array: {source}")]
    Damaged {
        /// Name of the array.
        name: String,
        /// The reader's error.
        source: std::io::Error,
    },
    /// The array has another element type.
    #[error("array `{name}`: dtype {found}; expected {expected}")]
    Type {
        /// Name of the array.
        name: String,
        /// dtype in the file.
        found: String,
        /// dtypes that are accepted.
        expected: &'static str,
    },
    /// The array is stored in Fortran order.
    #[error("array `{name}`: stored in Fortran order; expected C order (numpy.ascontiguousarray)")]
    FortranOrder {
        /// Name of the array.
        name: String,
    },
    /// The array declares more bytes than the limit.
    #[error("array `{name}`: declares {bytes} bytes; the limit is {limit} bytes")]
    TooLarge {
        /// Name of the array.
        name: String,
        /// Declared size; `u64::MAX` if it does not fit 64 bits.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
}

/// An open file.
pub struct Npz {
    archive: ZipArchive<BufReader<File>>,
    max_array_bytes: u64,
}

impl Npz {
    /// Opens a file; arrays larger than [`ArrayLimits::DEFAULT`] are refused.
    ///
    /// # Errors
    /// The file cannot be read, or is not a zip archive.
    pub fn open(path: &Path) -> Result<Self, NpzError> {
        let archive = ZipArchive::new(BufReader::new(File::open(path)?)).map_err(|source| {
            NpzError::Archive {
                path: path.to_owned(),
                source,
            }
        })?;
        Ok(Self {
            archive,
            max_array_bytes: ArrayLimits::DEFAULT.max_bytes,
        })
    }

    /// The same file, with another limit on the size of one array, bytes after decompression.
    #[must_use]
    pub fn with_max_array_bytes(self, max_array_bytes: u64) -> Self {
        Self {
            max_array_bytes,
            ..self
        }
    }

    /// Reads an array of floating point numbers, stored as `<f4` or `<f8`.
    ///
    /// # Errors
    /// The array is missing, too large, damaged or of another type.
    pub fn floats(&mut self, name: &str) -> Result<Array<f64>, NpzError> {
        self.read(name, "f4 or f8", |file| {
            match width_of(&file, TypeChar::Float) {
                Some(4) => Some(
                    file.into_vec::<f32>()
                        .map(|values| values.into_iter().map(f64::from).collect()),
                ),
                Some(8) => Some(file.into_vec::<f64>()),
                _ => None,
            }
        })
    }

    /// Reads an array of bytes, such as a picture, stored as `|u1`.
    ///
    /// # Errors
    /// As [`Npz::floats`].
    pub fn bytes(&mut self, name: &str) -> Result<Array<u8>, NpzError> {
        self.read(name, "u1", |file| match width_of(&file, TypeChar::Uint) {
            Some(1) => Some(file.into_vec::<u8>()),
            _ => None,
        })
    }

    /// Reads an array; `values` gives `None` if the type is not an expected one.
    fn read<T>(
        &mut self,
        name: &str,
        expected: &'static str,
        values: impl FnOnce(NpyFile<&mut dyn Read>) -> Option<std::io::Result<Vec<T>>>,
    ) -> Result<Array<T>, NpzError> {
        let limit = self.max_array_bytes;
        let owned = || name.to_owned();
        let damaged = |source| NpzError::Damaged {
            name: owned(),
            source,
        };
        let mut member = match self.archive.by_name(&format!("{name}.npy")) {
            Ok(member) => member,
            Err(ZipError::FileNotFound) => return Err(NpzError::Missing { name: owned() }),
            Err(error) => return Err(damaged(error.into())),
        };
        let too_large = |bytes| NpzError::TooLarge {
            name: owned(),
            bytes,
            limit,
        };
        let header = header(&mut member).map_err(damaged)?;
        if element_count(&header).is_none() {
            return Err(too_large(u64::MAX));
        }
        let mut reader = header.as_slice().chain(&mut member);
        let file = NpyFile::new(&mut reader as &mut dyn Read).map_err(damaged)?;
        let bytes = declared_bytes(&file);
        if bytes > limit {
            return Err(too_large(bytes));
        }
        if file.order() == Order::Fortran && file.shape().len() > 1 {
            return Err(NpzError::FortranOrder { name: owned() });
        }
        let shape = file.shape().iter().map(|&side| side as usize).collect();
        let found = file.dtype().descr();
        let values = values(file)
            .ok_or_else(|| NpzError::Type {
                name: owned(),
                found,
                expected,
            })?
            .map_err(damaged)?;
        if reader.read(&mut [0]).map_err(damaged)? > 0 {
            let longer = std::io::Error::other("more bytes than its shape declares");
            return Err(damaged(longer));
        }
        Ok(Array { values, shape })
    }
}

/// Longest header that is read, bytes: NumPy writes 128, a structured type a few thousand.
const MAX_HEADER_BYTES: usize = 1 << 16;

/// Deepest nesting of brackets in a header. Plain types have 2 levels, structured ones 4; the time to parse them grows exponentially.
const MAX_NESTING: usize = 6;

/// The bytes of an array before its values: magic, version, length of the description, description (`numpy.lib.format`).
fn header(reader: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut bytes = vec![0; 8];
    reader.read_exact(&mut bytes)?;
    // The length has two bytes in version 1, four in versions 2 and 3.
    let length_bytes = if bytes[6] == 1 { 2 } else { 4 };
    bytes.resize(8 + length_bytes, 0);
    reader.read_exact(&mut bytes[8..])?;
    let length = bytes[8..]
        .iter()
        .rev()
        .fold(0, |length, &byte| length << 8 | usize::from(byte));
    if length > MAX_HEADER_BYTES {
        return Err(std::io::Error::other("its header is too long"));
    }
    let start = bytes.len();
    bytes.resize(start + length, 0);
    reader.read_exact(&mut bytes[start..])?;
    if nesting(&bytes[start..]) > MAX_NESTING {
        return Err(std::io::Error::other("its header is nested too deeply"));
    }
    Ok(bytes)
}

/// How deep the brackets of a description are nested.
fn nesting(description: &[u8]) -> usize {
    let (_, deepest) = description
        .iter()
        .fold((0usize, 0), |(depth, deepest), byte| {
            let depth = match byte {
                b'(' | b'[' | b'{' => depth + 1,
                b')' | b']' | b'}' => depth.saturating_sub(1),
                _ => depth,
            };
            (depth, deepest.max(depth))
        });
    deepest
}

/// Number of elements that a header declares; `None` if it does not fit 64 bits, which the reader below does not check.
fn element_count(header: &[u8]) -> Option<u64> {
    let text = String::from_utf8_lossy(header);
    let shape = text.split("shape").nth(1).unwrap_or("");
    let shape = shape.split(')').next().unwrap_or("");
    shape
        .split(|c: char| !c.is_ascii_digit())
        .filter(|digits| !digits.is_empty())
        .try_fold(1u64, |count, digits| {
            count.checked_mul(digits.parse().ok()?)
        })
}

/// Size of an array by its shape and element type, bytes; an element of unknown width counts as one byte.
fn declared_bytes<R: Read>(file: &NpyFile<R>) -> u64 {
    let width = file.dtype().num_bytes().unwrap_or(1) as u64;
    file.shape()
        .iter()
        .try_fold(width, |bytes, &side| bytes.checked_mul(side))
        .unwrap_or(u64::MAX)
}

/// Bytes of an element, if it is a plain number of this kind.
fn width_of<R: Read>(file: &NpyFile<R>, kind: TypeChar) -> Option<u64> {
    match file.dtype() {
        DType::Plain(plain) if plain.type_char() == kind => Some(plain.size_field()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    /// An `.npy` array of version 1 with this description.
    fn npy(description: &str, data: &[u8]) -> Vec<u8> {
        let length = (description.len() as u16).to_le_bytes();
        [
            b"\x93NUMPY\x01\x00",
            &length[..],
            description.as_bytes(),
            data,
        ]
        .concat()
    }

    /// An archive with `a.npy` in it.
    fn archive(array: &[u8]) -> (tempfile::TempDir, Npz) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.npz");
        let mut writer = zip::ZipWriter::new(File::create(&path).unwrap());
        let options = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Deflated);
        writer.start_file("a.npy", options).unwrap();
        writer.write_all(array).unwrap();
        writer.finish().unwrap();
        let npz = Npz::open(&path).unwrap();
        (folder, npz)
    }

    const PAIR: &str = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";

    #[test]
    fn arrays_are_read_by_type_and_shape() {
        let data = [1.5f32, -2.0].map(f32::to_le_bytes).concat();
        let read = archive(&npy(PAIR, &data)).1.floats("a").unwrap();
        assert_eq!((read.values, read.shape), (vec![1.5, -2.0], vec![1, 2]));
        let scalar = "{'descr': '<f8', 'fortran_order': False, 'shape': (), }\n";
        let read = archive(&npy(scalar, &3.25f64.to_le_bytes())).1.floats("a");
        assert_eq!(read.unwrap().values, [3.25]);
        let picture = "{'descr': '|u1', 'fortran_order': False, 'shape': (3,), }\n";
        let read = archive(&npy(picture, &[7, 8, 9])).1.bytes("a");
        assert_eq!(read.unwrap().values, [7, 8, 9]);
    }

    #[test]
    fn brackets_nested_deeply_are_refused_before_they_are_parsed() {
        let shape = "(".repeat(40);
        let deep = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}1\n");
        let error = archive(&npy(&deep, &[0; 8])).1.floats("a").unwrap_err();
        assert!(error.to_string().contains("nested too deeply"), "{error}");
    }

    #[test]
    fn unreadable_arrays_are_errors_and_no_panics() {
        let whole = npy(PAIR, &[0; 8]);
        for cut in 0..whole.len() {
            assert!(archive(&whole[..cut]).1.floats("a").is_err(), "{cut}");
        }
        let error = |description: &str, data: &[u8]| {
            archive(&npy(description, data)).1.floats("a").unwrap_err()
        };
        assert!(matches!(error(PAIR, &[0; 9]), NpzError::Damaged { .. }));
        let found = error(&PAIR.replace("<f4", "<i8"), &[0; 16]).to_string();
        assert_eq!(found, "array `a`: dtype '<i8'; expected f4 or f8");
        let fortran = error(&PAIR.replace("False", "True"), &[0; 8]);
        assert!(matches!(fortran, NpzError::FortranOrder { .. }));
        assert!(archive(&whole).1.bytes("a").is_err());
        let missing = archive(&whole).1.floats("b").unwrap_err().to_string();
        assert_eq!(missing, "no array `b` in the archive");
    }

    #[test]
    fn arrays_beyond_the_limit_are_refused_by_their_declared_size() {
        for shape in [
            "1, 536870912",
            "18446744073709551615, 2",
            "4294967296, 4294967296",
        ] {
            let huge = npy(&PAIR.replace("1, 2", shape), &[0; 4096]);
            let error = archive(&huge).1.floats("a").unwrap_err();
            assert!(
                matches!(error, NpzError::TooLarge { .. }),
                "{shape}: {error}"
            );
        }
        let (_folder, npz) = archive(&npy(PAIR, &[0; 8]));
        let error = npz.with_max_array_bytes(7).floats("a").unwrap_err();
        assert_eq!(
            error.to_string(),
            "array `a`: declares 8 bytes; the limit is 7 bytes"
        );
    }

    #[test]
    fn other_files_are_refused() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/anyvisloc/Scene_07");
        let error = Npz::open(&golden.join("L07_reference.json")).err().unwrap();
        assert!(error.to_string().contains("L07_reference.json"), "{error}");
        let mut npz = Npz::open(&golden.join("L07_0001.npz")).unwrap();
        assert!(npz.bytes("xyz").is_err());
        assert_eq!(npz.floats("K").unwrap().shape, [3, 3]);
    }
}
