//! Opens a map of any supported form.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::block::BlockSource;
use crate::block_cache::BlockCache;
use crate::content_hash::ContentHash;
use crate::csv_mosaic::open_mosaic;
use crate::geokeys::{FileCrs, crs_from_geokeys};
use crate::picture::Picture;
use crate::tiff::TiffMap;
use crate::tiff_georeference::place_of;
use crate::windowed::read_window;
use crate::world_file::{find_world_file, read_world_file};
use crate::{Affine, Corners, Crs, GeoError, Georeference, LonLat, Raster, RasterPatch, WindowPx};

const CORNERS_ORDER: &str = "the order is LL_LON,LL_LAT,UR_LON,UR_LAT";
/// Size of the cache of decoded blocks, bytes, unless a window needs more.
const DEFAULT_CACHE_BYTES: usize = 192 << 20;

/// Options for opening a map.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapOptions {
    /// The CRS, if the file does not give it or gives a wrong one; see [`Crs::parse`].
    pub crs: Option<String>,
    /// Longitude and latitude of the lower left and the upper right corner, degrees:
    /// `[LL_LON, LL_LAT, UR_LON, UR_LAT]`. They override any georeference in the file.
    pub corners: Option<[f64; 4]>,
    /// Size of the cache of decoded pixels, bytes; 192 MiB by default. It grows to at most 512 MiB if a window needs
    /// more.
    pub cache_bytes: Option<usize>,
}

/// Opens a map: a GeoTIFF or COG; a picture (JPEG, PNG, WebP, TIFF) with a world file and
/// `options.crs`; a picture with `options.corners`; or a `.csv` of pictures with corners. Pixels
/// are not decoded yet.
///
/// The georeference is, in this order, that of `options.corners`, of the file's GeoTIFF tags, of a
/// world file; the CRS is `options.crs`, else the file's own.
///
/// # Errors
/// Returns an error if the file cannot be read, is not a map, is truncated or damaged, or has no valid georeference.
pub fn open_map(path: &Path, options: &MapOptions) -> Result<Box<dyn Raster>, GeoError> {
    let crs = options.crs.as_deref().map(Crs::parse).transpose()?;
    let cache = Arc::new(BlockCache::new(
        options.cache_bytes.unwrap_or(DEFAULT_CACHE_BYTES),
    ));
    let is_table = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("csv"));
    if is_table {
        if options.corners.is_some() {
            return Err(GeoError::BadCorners {
                location: "corners".to_string(),
                reason: "a table of pictures already has corners; give none".to_string(),
            });
        }
        return Ok(Box::new(open_mosaic(path, cache)?));
    }
    if is_tiff(path)? {
        let map = TiffMap::open(path)?;
        let georeference = tiff_georeference(path, &map, crs, options)?;
        let files = map.images().files.clone();
        let kind = map.kind();
        return Ok(Box::new(SingleMap::new(
            path,
            Box::new(map),
            kind,
            georeference,
            files,
            cache,
        )));
    }
    let picture = Picture::open(path)?;
    let size_px = picture.size_px();
    let georeference = match corners_georeference(&crs, options, size_px)? {
        Some(georeference) => georeference,
        None => world_georeference(path, crs.map(FileCrs::from), size_px)?.ok_or_else(|| {
            no_georeference(path, "the picture has none, and there is no world file")
        })?,
    };
    let kind = picture.kind().to_string();
    let files = vec![path.to_path_buf()];
    Ok(Box::new(SingleMap::new(
        path,
        Box::new(picture),
        kind,
        georeference,
        files,
        cache,
    )))
}

fn is_tiff(path: &Path) -> Result<bool, GeoError> {
    let mut magic = [0_u8; 4];
    let mut file = std::fs::File::open(path).map_err(|e| GeoError::io(path, e))?;
    let mut have = 0;
    while have < magic.len() {
        match file.read(&mut magic[have..]) {
            Ok(0) => break,
            Ok(n) => have += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(GeoError::io(path, e)),
        }
    }
    if have == 0 {
        return Err(GeoError::NotAMap {
            path: path.to_path_buf(),
            reason: "it is empty".to_string(),
        });
    }
    // Classic and BigTIFF, either byte order.
    Ok(matches!(&magic, b"II*\0" | b"MM\0*" | b"II+\0" | b"MM\0+"))
}

fn no_georeference(path: &Path, reason: &str) -> GeoError {
    GeoError::NoGeoreference {
        path: path.to_path_buf(),
        reason: reason.to_string(),
    }
}

fn tiff_georeference(
    path: &Path,
    map: &TiffMap,
    crs: Option<Crs>,
    options: &MapOptions,
) -> Result<Georeference, GeoError> {
    let size_px = map.size_px();
    if let Some(georeference) = corners_georeference(&crs, options, size_px)? {
        return Ok(georeference);
    }
    let place = place_of(&map.images().levels[0].image).map_err(|e| e.in_file(path))?;
    let Some(affine) = place.affine else {
        // Some writers store the CRS in the file and the transform beside it.
        let crs = match (crs, &place.geokeys) {
            (Some(crs), _) => Some(crs.into()),
            (None, Some(keys)) => Some(crs_from_geokeys(keys, path)?),
            (None, None) => None,
        };
        let reason = place
            .other
            .unwrap_or("it has no GeoTIFF tags, and there is no world file");
        return world_georeference(path, crs, size_px)?
            .ok_or_else(|| no_georeference(path, reason));
    };
    let crs = match (crs, &place.geokeys) {
        (Some(crs), _) => crs.into(),
        (None, Some(keys)) => crs_from_geokeys(keys, path)?,
        (None, None) => {
            return Err(GeoError::MissingCrs {
                path: path.to_path_buf(),
                reason: "the file has a transform but no GeoKeys".to_string(),
            });
        }
    };
    georeference(path, affine, crs, size_px)
}

fn corners_georeference(
    crs: &Option<Crs>,
    options: &MapOptions,
    size_px: (u64, u64),
) -> Result<Option<Georeference>, GeoError> {
    let Some([ll_lon, ll_lat, ur_lon, ur_lat]) = options.corners else {
        return Ok(None);
    };
    let location = "corners";
    let crs = match crs {
        None => Crs::wgs84()?,
        Some(crs) if crs.is_geographic() => crs.clone(),
        Some(crs) => {
            return Err(GeoError::BadCorners {
                location: location.to_string(),
                reason: format!(
                    "they are longitude and latitude, and {crs} is projected; give no coordinate system or a geographic one"
                ),
            });
        }
    };
    let (ll, ur) = (LonLat::new(ll_lon, ll_lat), LonLat::new(ur_lon, ur_lat));
    let corners = Corners::new(ll, ur, size_px, location, CORNERS_ORDER)?;
    let affine = corners.affine(size_px)?;
    Ok(Some(Georeference::new(affine, crs, size_px)))
}

fn world_georeference(
    path: &Path,
    crs: Option<FileCrs>,
    size_px: (u64, u64),
) -> Result<Option<Georeference>, GeoError> {
    let Some(world_file) = find_world_file(path) else {
        return Ok(None);
    };
    let affine = read_world_file(&world_file)?;
    let crs = crs.ok_or_else(|| GeoError::MissingCrs {
        path: path.to_path_buf(),
        reason: format!("the world file {} does not give it", world_file.display()),
    })?;
    georeference(&world_file, affine, crs, size_px).map(Some)
}

/// Checks that the map lies on Earth. This detects a CRS that does not fit the transform, and swapped axes.
fn georeference(
    path: &Path,
    affine: Affine,
    crs: FileCrs,
    size_px: (u64, u64),
) -> Result<Georeference, GeoError> {
    let affine = affine
        .scaled(crs.crs_units_per_file_unit)
        .map_err(|e| e.in_file(path))?;
    let georeference = Georeference::new(affine, crs.crs, size_px);
    let (x, y) = affine.xy_from_map_px(georeference.centre_px());
    let crs = georeference.crs();
    if crs.is_geographic() && y.abs() > 90.0 && x.abs() <= 90.0 && y.abs() <= 180.0 {
        return Err(GeoError::SwappedLonLat {
            location: path.display().to_string(),
            reason: format!("the map's centre would have latitude {y}"),
            order: "x must be the longitude and y the latitude",
        });
    }
    if let Err(error) = georeference.lonlat_from_map_px(georeference.centre_px()) {
        return Err(GeoError::UnsupportedCrs {
            path: path.to_path_buf(),
            crs: crs.to_string(),
            reason: format!("the map's centre lies outside it ({error})"),
        });
    }
    if let Some(caveat) = crs.caveat() {
        tracing::warn!(map = %path.display(), crs = %crs, "{caveat}");
    }
    Ok(georeference)
}

/// A map in one file.
struct SingleMap {
    path: PathBuf,
    source: Box<dyn BlockSource>,
    kind: String,
    georeference: Georeference,
    hash: ContentHash,
    cache: Arc<BlockCache>,
}

impl SingleMap {
    fn new(
        path: &Path,
        source: Box<dyn BlockSource>,
        kind: String,
        georeference: Georeference,
        mut files: Vec<PathBuf>,
        cache: Arc<BlockCache>,
    ) -> Self {
        files.extend(find_world_file(path));
        let hash = ContentHash::of(files);
        Self {
            path: path.to_path_buf(),
            source,
            kind,
            georeference,
            hash,
            cache,
        }
    }
}

impl Raster for SingleMap {
    fn size_px(&self) -> (u64, u64) {
        let full = self.source.levels()[0];
        (full.width, full.height)
    }

    fn georeference(&self) -> &Georeference {
        &self.georeference
    }

    fn content_hash(&self) -> Result<[u8; 32], GeoError> {
        self.hash.get()
    }

    fn read(&self, window: WindowPx, out_w: u32, out_h: u32) -> Result<RasterPatch, GeoError> {
        read_window(self.source.as_ref(), 0, &self.cache, window, out_w, out_h)
    }

    fn describe(&self) -> String {
        let (w, h) = self.size_px();
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let resolution = match self
            .georeference
            .ground_resolution_m(self.georeference.centre_px())
        {
            Ok((x, y)) => format!("{x:.3} x {y:.3} m per pixel"),
            Err(_) => "resolution unknown".to_string(),
        };
        format!(
            "{name}: {w} x {h} pixels, {}, {resolution}; {}",
            self.georeference.crs(),
            self.kind
        )
    }
}
