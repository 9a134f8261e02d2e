//! Georeferenced rasters, coordinate systems and metres on the ellipsoid.
//!
//! [`open_map`] opens a GeoTIFF or COG, several of them as one map (a folder, a list, a VRT), tiles
//! (PMTiles, a folder, MBTiles with the feature `mbtiles`), a picture with a world file, a picture
//! with two corners or a CSV of such pictures, and gives a [`Raster`]: windows of it can be read at
//! any ground resolution, and its [`Georeference`] turns map pixels into longitude and latitude.
//!
//! # Frames
//! - [`MapPx`]: continuous pixel coordinates of the full-resolution map, GDAL's convention:
//!   `(0, 0)` is the outer corner of the top-left pixel, whose centre is `(0.5, 0.5)`.
//! - [`LevelPx`]: continuous pixel coordinates of a level, the map resampled to square pixels on the
//!   ground; the same convention. [`LevelFrame`] converts between the two.
//! - [`LonLat`]: degrees on the WGS 84 ellipsoid, longitude in `[-180, 180)` where this crate gives it.
//! - Metres are metres on that ellipsoid: geodesics after Karney (2013).
//!
//! # Example
//! ```no_run
//! use grimnet_geo::{MapOptions, MapPx, WindowPx, open_map};
//!
//! # fn main() -> Result<(), grimnet_geo::GeoError> {
//! let map = open_map("map.tif".as_ref(), &MapOptions::default())?;
//! let patch = map.read(WindowPx::new(0.0, 0.0, 1024.0, 1024.0), 512, 512)?;
//! let corner = map.georeference().lonlat_from_map_px(MapPx::new(0.0, 0.0))?;
//! assert_eq!(patch.rgb.dimensions(), patch.valid.dimensions());
//! # let _ = corner;
//! # Ok(())
//! # }
//! ```
#![cfg_attr(doctest, doc = include_str!("../README.md"))]

mod affine;
mod antimeridian;
mod block;
mod block_cache;
mod block_canvas;
mod concerns;
mod content_hash;
mod corners;
mod crs;
mod csv_mosaic;
mod datum_names;
mod datum_shifts;
mod epsg_definitions;
mod error;
mod flipped_rows;
mod geokeys;
mod georeference;
mod heading;
mod hilbert;
mod level_frame;
mod level_px;
mod map_form;
mod map_options;
mod map_px;
#[cfg(feature = "mbtiles")]
mod mbtiles;
mod metres;
mod mosaic;
mod mosaic_grid;
mod mosaic_map;
mod open;
mod pam;
mod picture;
mod picture_block;
mod placing;
mod pmtiles;
mod pmtiles_directory;
mod projection;
mod raster;
mod resample;
mod samples;
mod sidecar_values;
mod single_map;
mod source_file;
mod stated_crs;
mod text_file;
mod tiff;
mod tiff_compression;
mod tiff_georeference;
mod tiff_images;
mod tiff_level;
mod tiff_strips;
mod tile_address;
mod tile_index;
mod tile_map;
mod tile_raster;
mod tile_store;
mod units;
mod vrt;
mod web_mercator;
mod windowed;
mod wkt;
mod wkt_definition;
mod world_file;
mod xml_tree;
mod xyz_folder;

pub use affine::Affine;
pub use concerns::{Concern, concerns, concerns_of_place, overview};
pub use corners::Corners;
pub use crs::Crs;
pub use error::GeoError;
pub use georeference::Georeference;
pub use heading::turn_deg;
pub use level_frame::LevelFrame;
pub use level_px::LevelPx;
pub use map_form::is_tiff_name;
pub use map_options::MapOptions;
pub use map_px::{MapPx, WindowPx};
pub use metres::{
    LonLat, bearing_deg, destination, destination_en_m, distance_m, offset_en_m, wrap_longitude_deg,
};
pub use open::open_map;
pub use raster::{Raster, RasterPatch};
pub use web_mercator::{lonlat_from_web_mercator, web_mercator_from_lonlat};
