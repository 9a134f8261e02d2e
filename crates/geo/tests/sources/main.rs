//! Maps of tiles and of several pictures, against GDAL (`make_sources.py`).

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod gdal;
#[cfg(feature = "mbtiles")]
mod mbtiles;
mod mosaics;
mod tiles;
