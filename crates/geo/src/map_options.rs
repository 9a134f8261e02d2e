//! Options for opening a map.

/// Options for opening a map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapOptions {
    /// The CRS, if the file does not give it or gives a wrong one; see [`crate::Crs::parse`].
    pub crs: Option<String>,
    /// Longitude and latitude of the lower left and the upper right corner, degrees:
    /// `[LL_LON, LL_LAT, UR_LON, UR_LAT]`. They override any georeference in the file.
    pub corners: Option<[f64; 4]>,
    /// Size of the cache of decoded pixels, bytes; 192 MiB by default. It grows to at most 512 MiB if a window needs
    /// more.
    pub cache_bytes: Option<usize>,
    /// The zoom of a map of tiles (folder, MBTiles, PMTiles); the finest by default. Coarser zooms are its overviews: a window
    /// is read from the zoom whose ground resolution is the next finer one.
    pub zoom: Option<u8>,
}
