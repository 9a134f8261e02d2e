//! Limits on what is read and built.

/// Limits on opening a pack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PackLimits {
    /// Features of a level up to this size are copied into memory when the pack is opened; larger ones stay in the
    /// file, which is mapped. A copied pack cannot be damaged by another program while it is in use. Default: 64 MiB.
    pub copy_features_bytes: u64,
    /// Mapped features up to this size are compared with their checksums when the pack is opened; larger ones are
    /// compared block by block on first use. Default: 512 MiB.
    pub verify_at_open_bytes: u64,
    /// Maximum size of the tables of a pack (tile descriptors, entries, index), which are copied into memory. Packs
    /// with larger ones are refused. Default: 8 GiB.
    pub max_table_bytes: u64,
}

impl Default for PackLimits {
    fn default() -> Self {
        Self {
            copy_features_bytes: 64 << 20,
            verify_at_open_bytes: 512 << 20,
            max_table_bytes: 8 << 30,
        }
    }
}

/// Limits on building a pack: what a plan would cost is compared with them before work starts.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct BuildLimits {
    /// Maximum number of tiles of all levels, skipped ones included. Default: 8 million.
    pub max_tiles: u64,
    /// Maximum estimated size of the pack. Default: 256 GiB.
    pub max_pack_bytes: u64,
    /// Minimum length of the longer side of the map at a level, level pixels. Default: 16.
    pub min_level_px: u64,
    /// Smallest and largest plausible size of a map pixel on the ground, metres: outside this range the coordinate
    /// system or the scale of the map is wrong. Default: 0.1 mm to 10 km.
    pub map_pixel_m: (f64, f64),
}

impl Default for BuildLimits {
    fn default() -> Self {
        Self {
            max_tiles: 8_000_000,
            max_pack_bytes: 256 << 30,
            min_level_px: 16,
            map_pixel_m: (1e-4, 1e4),
        }
    }
}
