//! The map pack: descriptors and local features of a map's tiles in one file.
//!
//! A pack holds *levels* of ground resolution. A level is cut into *tiles* of 512 px that overlap by half; each has a
//! descriptor, which [`Level::search`] compares, and keypoints with local descriptors. In the default [`Mode`] features are
//! computed and stored once per *cell* of 256 px, and a tile is four cells; in paper mode tiles are independent.
//!
//! [`build()`] makes a pack and can be interrupted at any moment; [`Pack::open`] refuses files that are damaged or do not
//! fit.
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

#[cfg(target_endian = "big")]
compile_error!("packs are little-endian and read without conversion");

mod builder;
mod draw;
mod error;
mod estimate;
mod feature_store;
mod features;
mod file;
pub mod format;
mod global_rows;
mod index;
mod info;
mod layout;
mod level;
mod level_tables;
mod local_descriptors;
pub mod manifest;
mod manifest_check;
mod mode;
mod options;
mod pack;
mod paper;
mod printable;
pub mod quantise;
mod search;
mod verify;
mod writer;

pub use builder::progress::{BuildReport, Phase, Progress};
pub use builder::resolutions::{COARSEST_FINE_GSD_M, FINEST_AUTO_GSD_M};
pub use builder::{build, build_interruptible, build_with_limits, working_files};
pub use draw::draw;
pub use error::{PackError, Result};
pub use estimate::{BuildEstimate, LevelEstimate, estimate};
pub use features::{FeatureBlock, TileFeatures};
pub use grimnet_limits::{BuildLimits, PackLimits};
pub use index::Index;
pub use info::{LevelInfo, PackInfo};
pub use level::{CELL_PX, Level, TILE_PX, TileInfo};
pub use local_descriptors::{DescriptorType, LocalDescriptors};
pub use manifest::Manifest;
pub use mode::Mode;
pub use options::{BuildOptions, Levels};
pub use pack::Pack;
pub use paper::{PAPER_INDEX, resize_for_network};
pub use search::{Filter, Hit, KeypointIndex, Neighbour, Reach};
pub use verify::VerifyProgress;
pub use writer::Writer;
