//! Damage of the compressed data of a picture.

use serde::Serialize;

/// What a check of compressed data gives.
pub(crate) type Checked<T> = Result<T, Damage>;

/// How the compressed data of a JPEG contradict themselves. Part of the picture is then wrong, or shifted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, thiserror::Error)]
#[non_exhaustive]
#[serde(rename_all = "snake_case")]
pub enum Damage {
    /// A code that no Huffman table holds.
    #[error("an invalid Huffman code")]
    HuffmanCode,
    /// A block of 8 x 8 pixels with more than 64 coefficients.
    #[error("a block with more than 64 coefficients")]
    TooManyCoefficients,
    /// A block brighter or darker than 8 bits allow.
    #[error("a block brighter or darker than 8 bits allow")]
    BrightnessOutOfRange,
    /// The data end before the last block of the picture.
    #[error("data that end before the picture does")]
    TooShort,
    /// Data are left after the last block of the picture.
    #[error("data left over after the end of the picture")]
    TooLong,
    /// A restart marker is missing or not in order.
    #[error("a restart marker missing or out of order")]
    RestartMarker,
    /// A scan whose header or tables cannot be used.
    #[error("an invalid scan header")]
    ScanHeader,
    /// Another contradiction that the decoder found.
    #[error("compressed data that cannot be decoded")]
    Undecodable,
}
