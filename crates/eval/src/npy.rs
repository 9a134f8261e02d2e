//! NumPy's `.npy` format (`numpy.lib.format`, versions 1 to 3), as far as plain numbers in C order go.

use std::io;

/// What every file begins with.
const MAGIC: &[u8] = b"\x93NUMPY";

/// An array: its values in C order, and its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Array<T> {
    /// The values, the last axis running fastest.
    pub values: Vec<T>,
    /// Length of each axis; empty for a scalar.
    pub shape: Vec<usize>,
}

/// Reads floating point numbers, stored as `<f4` or `<f8`.
///
/// # Errors
/// Damaged, or something else.
pub fn floats(bytes: &[u8]) -> io::Result<Array<f64>> {
    let file = Npy::parse(bytes)?;
    let values = match file.kind {
        "<f4" => file.values(|b: [u8; 4]| f64::from(f32::from_le_bytes(b))),
        "<f8" => file.values(f64::from_le_bytes),
        other => Err(wrong(&format!("holds {other} and no numbers with a point"))),
    }?;
    Ok(Array {
        values,
        shape: file.shape,
    })
}

/// Reads bytes, stored as `|u1`.
///
/// # Errors
/// Damaged, or something else.
pub fn bytes(bytes: &[u8]) -> io::Result<Array<u8>> {
    let file = Npy::parse(bytes)?;
    let values = match file.kind {
        "|u1" => file.values(|[b]| b),
        other => Err(wrong(&format!("holds {other} and no bytes"))),
    }?;
    Ok(Array {
        values,
        shape: file.shape,
    })
}

/// A file taken apart.
struct Npy<'a> {
    kind: &'a str,
    shape: Vec<usize>,
    data: &'a [u8],
}

fn wrong(reason: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}

impl<'a> Npy<'a> {
    /// Magic, version, length of the header, a header such as
    /// `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 3), }`, the values.
    fn parse(bytes: &'a [u8]) -> io::Result<Self> {
        let damaged = || wrong("is no .npy array, or damaged");
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(damaged)?;
        let (length, rest) = match rest {
            [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
            [2 | 3, _, a, b, c, d, rest @ ..] => {
                (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest)
            }
            _ => return Err(damaged()),
        };
        let (header, data) = rest.split_at_checked(length).ok_or_else(damaged)?;
        let header = std::str::from_utf8(header).map_err(|_| damaged())?;
        let entry = |name: &str| header.split_once(name).map(|(_, value)| value.trim_start());
        let kind = entry("'descr':")
            .and_then(|value| value.strip_prefix('\'')?.split('\'').next())
            .ok_or_else(|| wrong("holds no plain numbers"))?;
        let (shape, _) = entry("'shape':")
            .and_then(|value| value.strip_prefix('(')?.split_once(')'))
            .ok_or_else(damaged)?;
        let shape: Vec<usize> = shape
            .split(',')
            .map(str::trim)
            .filter(|length| !length.is_empty())
            .map(|length| length.parse().map_err(|_| damaged()))
            .collect::<Result<_, _>>()?;
        let by_columns = entry("'fortran_order':").is_none_or(|value| !value.starts_with("False"));
        if by_columns && shape.len() > 1 {
            return Err(wrong("is stored column by column"));
        }
        Ok(Self { kind, shape, data })
    }

    /// The values, each of `N` bytes.
    fn values<T, const N: usize>(&self, value: impl Fn([u8; N]) -> T) -> io::Result<Vec<T>> {
        let (chunks, rest) = self.data.as_chunks::<N>();
        let count = self
            .shape
            .iter()
            .try_fold(1usize, |count, &length| count.checked_mul(length));
        if count != Some(chunks.len()) || !rest.is_empty() {
            return Err(wrong("is shorter or longer than its shape"));
        }
        Ok(chunks.iter().map(|chunk| value(*chunk)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    #[test]
    fn numbers_are_read_by_kind_and_shape() {
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";
        let data = [1.5f32, -2.0].map(f32::to_le_bytes).concat();
        let read = floats(&file(header, &data)).unwrap();
        assert_eq!((read.values, read.shape), (vec![1.5, -2.0], vec![1, 2]));
        let scalar = "{'descr': '<f8', 'fortran_order': False, 'shape': (), }";
        let read = floats(&file(scalar, &3.25f64.to_le_bytes())).unwrap();
        assert_eq!((read.values, read.shape), (vec![3.25], vec![]));
        let picture = "{'descr': '|u1', 'fortran_order': False, 'shape': (3,), }";
        assert_eq!(bytes(&file(picture, &[7, 8, 9])).unwrap().values, [7, 8, 9]);
    }

    #[test]
    fn what_cannot_be_read_is_an_error_and_no_panic() {
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }";
        let whole = file(header, &[0; 8]);
        for cut in 0..whole.len() {
            assert!(floats(&whole[..cut]).is_err(), "{cut}");
        }
        let says = |header: &str| floats(&file(header, &[0; 8])).unwrap_err().to_string();
        assert!(says(&header.replace("<f4", "|O")).contains("holds |O"));
        assert!(says(&header.replace("False", "True")).contains("column by column"));
        assert!(says(&header.replace("1, 2", "1, 3")).contains("its shape"));
        let huge = header.replace("1, 2", "18446744073709551615, 2");
        assert!(says(&huge).contains("its shape"));
        assert!(bytes(&whole).is_err());
    }
}
