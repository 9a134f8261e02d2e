//! Opens a map of any supported form.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::block::BlockSource;
use crate::block_cache::BlockCache;
use crate::content_hash::{ContentHash, ContentValues};
use crate::csv_mosaic::open_mosaic;
use crate::map_form::{MapForm, form_of};
use crate::map_options::MapOptions;
use crate::mosaic_map::{open_list, open_vrt};
use crate::picture::Picture;
use crate::placing::{Placed, place_picture, place_tiff};
use crate::pmtiles::PmTiles;
use crate::single_map::SingleMap;
use crate::tiff::TiffMap;
use crate::tile_raster::TileRaster;
use crate::tile_store::TileStore;
use crate::xyz_folder::XyzFolder;
use crate::{Crs, GeoError, Georeference, Raster};

/// Size of the cache of decoded blocks, bytes, unless a window needs more.
const DEFAULT_CACHE_BYTES: usize = 192 << 20;

/// Opens a map. Pixels are not decoded yet. A map is one of
/// - a GeoTIFF or COG;
/// - a picture (JPEG, PNG, WebP, TIFF) with a world file and `options.crs`, or with `options.corners`;
/// - a `.csv` of pictures with corners;
/// - several GeoTIFFs, the later ones above: a `.vrt` of GDAL, a `.txt` that lists them, or a folder of them, in order of
///   their names;
/// - tiles of the Web Mercator grid: an MBTiles file (with the feature `mbtiles`), a PMTiles file, or a folder
///   `{zoom}/{column}/{row}.png`.
///
/// The georeference is, in this order, that of `options.corners`, of the file's GeoTIFF tags, of GDAL's
/// `.aux.xml`, of a world file; the CRS is `options.crs`, else the file's own.
///
/// # Errors
/// Returns an error if the file cannot be read, is not a map, is truncated or damaged, or has no valid georeference, and
/// [`GeoError::Mirrored`] for a map that shows the ground mirrored.
pub fn open_map(path: &Path, options: &MapOptions) -> Result<Box<dyn Raster>, GeoError> {
    let map = open_form(path, options)?;
    check_not_mirrored(path, map.georeference())?;
    let crs = map.georeference().crs();
    if let Some(caveat) = crs.caveat() {
        tracing::warn!(map = %path.display(), crs = %crs, "{caveat}");
    }
    for caveat in map.caveats() {
        tracing::warn!(map = %path.display(), "{caveat}");
    }
    Ok(map)
}

fn open_form(path: &Path, options: &MapOptions) -> Result<Box<dyn Raster>, GeoError> {
    let crs = options.crs.as_deref().map(Crs::parse).transpose()?;
    let cache = Arc::new(BlockCache::new(
        options.cache_bytes.unwrap_or(DEFAULT_CACHE_BYTES),
    ));
    let form = form_of(path)?;
    check_options(form, path, options)?;
    match form {
        MapForm::Table => Ok(Box::new(open_mosaic(path, cache)?)),
        MapForm::Vrt => Ok(Box::new(open_vrt(path, crs, options, cache)?)),
        MapForm::List | MapForm::TiffFolder => Ok(Box::new(open_list(path, crs, options, cache)?)),
        MapForm::TileFolder => tiles(XyzFolder::open(path)?, options, cache),
        MapForm::PmTiles => tiles(PmTiles::open(path)?, options, cache),
        #[cfg(feature = "mbtiles")]
        MapForm::Sqlite => tiles(crate::mbtiles::MbTiles::open(path)?, options, cache),
        #[cfg(not(feature = "mbtiles"))]
        MapForm::Sqlite => Err(GeoError::Unsupported {
            path: path.to_path_buf(),
            what: "MBTiles in a build without the feature `mbtiles`".to_string(),
            advice: "convert it: gdal_translate -of COG -co COMPRESS=JPEG IN.mbtiles OUT.tif",
        }),
        MapForm::Tiff => {
            let map = TiffMap::open(path)?;
            let placed = place_tiff(path, &map, crs, options)?;
            let (kind, files) = (map.kind(), map.images().files.clone());
            Ok(single(path, Box::new(map), kind, placed, files, cache))
        }
        MapForm::Picture => open_picture(path, crs, options, cache),
    }
}

/// Refuses options that would have no effect on a map of this form.
fn check_options(form: MapForm, path: &Path, options: &MapOptions) -> Result<(), GeoError> {
    let is_tiles = matches!(
        form,
        MapForm::TileFolder | MapForm::PmTiles | MapForm::Sqlite
    );
    let place = |reason: &str| GeoError::BadCorners {
        location: path.display().to_string(),
        reason: reason.to_string(),
    };
    if form == MapForm::Table && options.corners.is_some() {
        return Err(place("a table of pictures already has corners; give none"));
    }
    if form == MapForm::Table && options.crs.is_some() {
        return Err(place(
            "the corners in a table are longitude and latitude on WGS 84; give no coordinate system",
        ));
    }
    if is_tiles && (options.corners.is_some() || options.crs.is_some()) {
        return Err(place(
            "tiles lie in the Web Mercator grid (EPSG:3857); give neither corners nor a coordinate system",
        ));
    }
    if !is_tiles && let Some(zoom) = options.zoom {
        return Err(GeoError::NoSuchZoom {
            path: path.to_path_buf(),
            zoom,
            zooms: Vec::new(),
        });
    }
    Ok(())
}

/// Refuses a map that shows the ground mirrored: photos are turned to fit a map and never mirrored, so none would fit.
fn check_not_mirrored(path: &Path, georeference: &Georeference) -> Result<(), GeoError> {
    // Where the projection ends beside the centre, the map has no ground resolution either, and no pack is built of it.
    let Ok(jacobian) = georeference.east_north_m_from_map_px_jacobian(georeference.centre_px())
    else {
        return Ok(());
    };
    // Rows of a usable map run from north to south.
    if jacobian.determinant() > 0.0 {
        return Err(GeoError::Mirrored {
            path: path.to_path_buf(),
        });
    }
    Ok(())
}

fn tiles(
    store: impl TileStore + 'static,
    options: &MapOptions,
    cache: Arc<BlockCache>,
) -> Result<Box<dyn Raster>, GeoError> {
    let map = TileRaster::new(Box::new(store), options.zoom, cache)?;
    Ok(Box::new(map))
}

fn open_picture(
    path: &Path,
    crs: Option<Crs>,
    options: &MapOptions,
    cache: Arc<BlockCache>,
) -> Result<Box<dyn Raster>, GeoError> {
    let picture = Picture::open(path)?;
    let size_px = picture.size_px();
    let placed = place_picture(path, crs, options, size_px)?;
    let kind = picture.kind().to_string();
    let files = vec![path.to_path_buf()];
    let source = Box::new(picture);
    Ok(single(path, source, kind, placed, files, cache))
}

/// A map of one picture, whose pixels are in `files`.
fn single(
    path: &Path,
    source: Box<dyn BlockSource>,
    kind: String,
    placed: Placed,
    files: Vec<PathBuf>,
    cache: Arc<BlockCache>,
) -> Box<dyn Raster> {
    let mut values = ContentValues::default();
    placed.sidecars.add_to(&mut values);
    let hash = ContentHash::of(files).with_values(values);
    let map = SingleMap::new(path, source, kind, placed.georeference, hash, cache);
    Box::new(map.with_caveats(placed.caveats))
}
