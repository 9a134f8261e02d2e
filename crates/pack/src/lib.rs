//! The map pack: a map's tiles as a network sees them, in one file that is mapped into memory.
//!
//! A pack holds *levels* of ground resolution. A level is cut into *tiles* of 512 px that overlap by half; each has a
//! descriptor, which [`Level::search`] compares, and keypoints with local descriptors. In the default [`Mode`] features are
//! computed and stored once per *cell* of 256 px, and a tile is four cells; in paper mode tiles are independent.
//!
//! [`build()`] makes a pack and can be interrupted at any moment; [`Pack::open`] refuses files that are damaged or do not
//! fit.

#[cfg(target_endian = "big")]
compile_error!("packs are little-endian and mapped into memory as they are");

mod builder;
mod draw;
mod error;
mod features;
pub mod format;
mod index;
mod info;
mod level;
pub mod manifest;
mod mapped;
mod mode;
mod options;
mod pack;
mod paper;
pub mod quantise;
mod search;
mod writer;

pub use builder::build;
pub use builder::progress::{BuildReport, Phase, Progress};
pub use builder::resolutions::FINEST_AUTO_GSD_M;
pub use draw::draw;
pub use error::{PackError, Result};
pub use features::{FeatureBlock, TileFeatures};
pub use index::Index;
pub use info::{LevelInfo, PackInfo};
pub use level::{CELL_PX, Level, TILE_PX, TileInfo};
pub use manifest::Manifest;
pub use mode::Mode;
pub use options::{BuildOptions, Levels};
pub use pack::{Check, FULL_CHECK_LEN, Pack};
pub use paper::PAPER_INDEX;
pub use search::{Filter, Hit};
pub use writer::Writer;
