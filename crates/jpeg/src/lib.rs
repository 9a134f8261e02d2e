//! Decodes JPEG pictures, and finds damage of their compressed data.
//!
//! ```
//! # let mut bytes = Vec::new();
//! # let encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
//! # image::RgbImage::new(64, 48).write_with_encoder(encoder)?;
//! let jpeg = grimnet_jpeg::Jpeg::read(&bytes)?;
//! assert_eq!(jpeg.size_px(), (64, 48)); // before anything is decoded
//! let decoded = jpeg.decode()?;
//! assert_eq!(decoded.image.dimensions(), (64, 48));
//! assert!(decoded.damage.is_none());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod bits;
mod block;
mod damage;
mod decode;
mod error;
mod huffman;
mod reduced;
mod restart;
mod scan;
mod scan_header;
mod segments;
mod structure;
mod tables;

pub use damage::Damage;
pub use decode::{DecodedJpeg, Jpeg};
pub use error::JpegError;
pub use reduced::Reduction;
pub use scan::check_scans;
pub use segments::JpegSegments;
