//! Limits on memory and work for untrusted input, with their defaults, in one place.
//!
//! Sizes that a file states are compared with these limits before memory is allocated or work starts. [`Limits::rows`] lists all
//! of them as `SECURITY.md` states them.
//!
//! What reads photos or `.npz` arrays and what opens or builds packs takes other limits from its caller; those of maps are fixed.
//!
//! ```
//! let limits = grimnet_limits::PhotoLimits::of_memory(4 << 30);
//! assert_eq!(limits.max_memory_bytes, 4_294_967_296);
//! ```

const MIB: u64 = 1 << 20;
const GIB: u64 = 1 << 30;

/// All limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Limits {
    /// Limits on one photo.
    pub photo: PhotoLimits,
    /// Limits on arrays of data sets.
    pub array: ArrayLimits,
    /// Limits on maps.
    pub map: MapLimits,
    /// Limits on building a pack.
    pub build: BuildLimits,
    /// Limits on opening a pack.
    pub pack: PackLimits,
}

/// Limits on one photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PhotoLimits {
    /// Maximum memory for reading and decoding a photo: the file, the decoded picture, and what the decoder needs beside it,
    /// estimated from the file's size and headers. Default: 1 GiB.
    pub max_memory_bytes: u64,
}

impl PhotoLimits {
    /// The default limits.
    pub const DEFAULT: Self = Self::of_memory(GIB);

    /// Limits with this maximum of memory.
    #[must_use]
    pub const fn of_memory(max_memory_bytes: u64) -> Self {
        Self { max_memory_bytes }
    }
}

impl Default for PhotoLimits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Limits on arrays of data sets (`.npz`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ArrayLimits {
    /// Maximum size of one array after decompression. Default: 1 GiB.
    pub max_bytes: u64,
}

impl ArrayLimits {
    /// The default limits.
    pub const DEFAULT: Self = Self { max_bytes: GIB };
}

impl Default for ArrayLimits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Limits on maps. They are fixed: those used are [`MapLimits::DEFAULT`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct MapLimits {
    /// Maximum number of pixels of a JPEG, PNG or WebP map, which is decoded as a whole. Default: 2^28.
    pub max_picture_px: u64,
    /// Maximum size of one tile or strip of a GeoTIFF, decoded. Default: 256 MiB.
    pub max_block_bytes: u64,
    /// Maximum number of pixels of a window after resampling. Default: 2^28.
    pub max_window_px: u64,
    /// Maximum side of a window, map pixels. Default: 2^27.
    pub max_window_side_px: u64,
    /// Maximum number of tiles of a map of tiles (folder, MBTiles, PMTiles), all zooms together. Default: 2^24.
    pub max_tiles: u64,
    /// Maximum size of one such tile as stored. Default: 64 MiB.
    pub max_tile_bytes: u64,
    /// Maximum side of one such tile, pixels. Default: 2^12.
    pub max_tile_side_px: u32,
    /// Maximum size of the directories of a PMTiles file, decompressed, and of their entries in memory. Default: 1 GiB.
    pub max_directory_bytes: u64,
    /// Maximum number of pictures that a VRT, a list or a folder puts together. Default: 2^16.
    pub max_mosaic_pictures: u64,
    /// Maximum size of a VRT, a PAM file (`.aux.xml`) or a list of GeoTIFFs. Default: 128 MiB.
    pub max_description_bytes: u64,
}

impl MapLimits {
    /// The default limits.
    pub const DEFAULT: Self = Self {
        max_picture_px: 1 << 28,
        max_block_bytes: 256 * MIB,
        max_window_px: 1 << 28,
        max_window_side_px: 1 << 27,
        max_tiles: 1 << 24,
        max_tile_bytes: 64 * MIB,
        max_tile_side_px: 1 << 12,
        max_directory_bytes: GIB,
        max_mosaic_pictures: 1 << 16,
        max_description_bytes: 128 * MIB,
    };
}

impl Default for MapLimits {
    fn default() -> Self {
        Self::DEFAULT
    }
}

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
            copy_features_bytes: 64 * MIB,
            verify_at_open_bytes: 512 * MIB,
            max_table_bytes: 8 * GIB,
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
            max_pack_bytes: 256 * GIB,
            min_level_px: 16,
            map_pixel_m: (1e-4, 1e4),
        }
    }
}

impl Limits {
    /// What is limited, and the limit, in words. A table: its length is that of its rows.
    #[must_use]
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let (smallest_m, largest_m) = self.build.map_pixel_m;
        vec![
            (
                "photo: memory to read and decode it",
                size(self.photo.max_memory_bytes),
            ),
            (
                "array of a data set, decompressed",
                size(self.array.max_bytes),
            ),
            (
                "map as one picture (JPEG, PNG, WebP)",
                format!("{} pixels", power(self.map.max_picture_px)),
            ),
            (
                "tile or strip of a GeoTIFF, decoded",
                size(self.map.max_block_bytes),
            ),
            (
                "window of a map that is read, resampled",
                format!("{} pixels", power(self.map.max_window_px)),
            ),
            (
                "side of a window of a map that is read",
                format!("{} pixels", power(self.map.max_window_side_px)),
            ),
            (
                "map of tiles: tiles of all zooms",
                power(self.map.max_tiles),
            ),
            (
                "map of tiles: one tile as stored",
                size(self.map.max_tile_bytes),
            ),
            (
                "map of tiles: side of a tile",
                format!("{} pixels", power(u64::from(self.map.max_tile_side_px))),
            ),
            (
                "map of tiles: directories of PMTiles, decompressed, and their entries in memory",
                size(self.map.max_directory_bytes),
            ),
            (
                "map of several pictures: pictures",
                power(self.map.max_mosaic_pictures),
            ),
            (
                "map: its VRT, list or .aux.xml",
                size(self.map.max_description_bytes),
            ),
            (
                "map pixel on the ground",
                format!("{} mm to {} km", smallest_m * 1e3, largest_m / 1e3),
            ),
            (
                "longer side of the map at a level, at least",
                format!("{} pixels", self.build.min_level_px),
            ),
            (
                "pack: tiles",
                format!("{} million", self.build.max_tiles as f64 / 1e6),
            ),
            (
                "pack: estimated size when built",
                size(self.build.max_pack_bytes),
            ),
            (
                "pack: tile descriptors, entries and index, which are copied into memory",
                size(self.pack.max_table_bytes),
            ),
            (
                "pack: features of a level that are copied into memory",
                size(self.pack.copy_features_bytes),
            ),
            (
                "pack: features of a level that are verified when it is opened",
                size(self.pack.verify_at_open_bytes),
            ),
        ]
    }
}

/// `3 MiB`, or `1.5 GiB`.
#[must_use]
pub fn size(bytes: u64) -> String {
    if bytes < GIB {
        let mib = bytes as f64 / MIB as f64;
        format!("{} MiB", (10.0 * mib).round() / 10.0)
    } else {
        let gib = bytes as f64 / GIB as f64;
        format!("{} GiB", (10.0 * gib).round() / 10.0)
    }
}

/// `2^28`, or the number.
fn power(value: u64) -> String {
    if value.is_power_of_two() {
        format!("2^{}", value.trailing_zeros())
    } else {
        value.to_string()
    }
}
