//! A VRT, a list or a folder of GeoTIFFs as one map.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use grimnet_limits::MapLimits;

use crate::block::BlockSource;
use crate::block_cache::BlockCache;
use crate::map_form::is_tiff_name;
use crate::map_options::MapOptions;
use crate::mosaic::{Member, Mosaic};
use crate::placing::{corners_georeference, georeference, tiff_georeference};
use crate::single_map::SingleMap;
use crate::source_file::{OpenFiles, SourceFile, open_source};
use crate::tiff::TiffMap;
use crate::vrt::read_vrt;
use crate::{Affine, Crs, GeoError, Georeference, WindowPx};

/// Pictures, at most.
const MAX_PICTURES: usize = MapLimits::DEFAULT.max_mosaic_pictures as usize;
/// Largest list that is read, bytes.
const MAX_LIST_BYTES: u64 = MapLimits::DEFAULT.max_description_bytes;
/// Edges within this distance of whole pixels lie on them, pixels.
const WHOLE_PIXEL_TOLERANCE: f64 = 1e-3;
/// Ratio of sides above which pixels have other sizes.
const SIZE_TOLERANCE: f64 = 1e-9;

/// Opens a VRT.
pub(crate) fn open_vrt(
    path: &Path,
    crs: Option<Crs>,
    options: &MapOptions,
    cache: Arc<BlockCache>,
) -> Result<SingleMap, GeoError> {
    let vrt = read_vrt(path)?;
    let mut crs_of_file = vrt.crs.clone();
    let mut members = Members::default();
    for source in &vrt.sources {
        let file = regular(&source.file)?;
        let (opened, facts) = open_source(file, source.nodata)?;
        if vrt.is_grey && !facts.is_grey {
            return Err(GeoError::Unsupported {
                path: path.to_path_buf(),
                what: format!("one band of the colours of {}", file.display()),
                advice: "take all three bands, or convert it: gdal_translate IN.vrt OUT.tif",
            });
        }
        let full = opened.levels()[0];
        let inside = source.from.x >= 0.0
            && source.from.y >= 0.0
            && source.from.x + source.from.w <= full.width as f64 + 1.0
            && source.from.y + source.from.h <= full.height as f64 + 1.0;
        if !inside {
            return Err(GeoError::damaged(
                path,
                format!(
                    "it takes more of {} than its {} x {} pixels; make the VRT again",
                    file.display(),
                    full.width,
                    full.height
                ),
            ));
        }
        members.add(
            file,
            source.nodata,
            opened.as_ref(),
            facts.files,
            source.from,
            source.to,
        );
    }
    if crs.is_none()
        && crs_of_file.is_none()
        && let Some(first) = vrt.sources.first()
        && let Ok(map) = TiffMap::open(&first.file)
        && let Ok(place) = tiff_georeference(&first.file, &map, None, &MapOptions::default())
    {
        // Well-known text without a code: gdalbuildvrt demands that all pictures have the same system.
        crs_of_file = Some(place.crs().clone());
    }
    let place = match corners_georeference(&crs, options, vrt.size_px)? {
        Some(place) => place,
        None => {
            let affine = vrt.affine.ok_or_else(|| GeoError::NoGeoreference {
                path: path.to_path_buf(),
                reason: "the VRT has no GeoTransform".to_string(),
            })?;
            let crs = crs.or(crs_of_file).ok_or_else(|| GeoError::MissingCrs {
                path: path.to_path_buf(),
                reason: "the VRT has none, or one without an EPSG code".to_string(),
            })?;
            georeference(path, affine, crs.into(), vrt.size_px)?
        }
    };
    let kind = format!("VRT of {} pictures", vrt.sources.len());
    Ok(members.map(path, kind, place, vrt.size_px, cache))
}

/// Opens a list of GeoTIFFs, one a line, or the GeoTIFFs in a folder in order of their names.
pub(crate) fn open_list(
    path: &Path,
    crs: Option<Crs>,
    options: &MapOptions,
    cache: Arc<BlockCache>,
) -> Result<SingleMap, GeoError> {
    if options.corners.is_some() {
        return Err(GeoError::BadCorners {
            location: path.display().to_string(),
            reason: "each GeoTIFF has its own place; give no corners".to_string(),
        });
    }
    let files = if path.is_dir() {
        geotiffs_in(path)?
    } else {
        listed(path)?
    };
    let mut pictures = Vec::with_capacity(files.len());
    for file in &files {
        let file = regular(file)?;
        let (opened, facts) = open_source(file, None)?;
        let map = TiffMap::open(file)?;
        let place = tiff_georeference(file, &map, crs.clone(), options)?;
        let full = opened.levels()[0];
        pictures.push((place, (full.width, full.height)));
        drop((opened, facts));
    }
    let grid = Grid::of(path, &files, &pictures)?;
    let mut members = Members::default();
    for (file, (place, size_px)) in files.iter().zip(&pictures) {
        let (opened, facts) = open_source(file, None)?;
        let from = WindowPx::new(0.0, 0.0, size_px.0 as f64, size_px.1 as f64);
        let to = grid.place(place, *size_px);
        members.add(file, None, opened.as_ref(), facts.files, from, to);
    }
    let kind = format!("{} GeoTIFFs", files.len());
    let crs = pictures[0].0.crs().clone();
    let place = georeference(path, grid.affine(path)?, crs.into(), grid.size_px)?;
    Ok(members.map(path, kind, place, grid.size_px, cache))
}

/// The grid of pixels that pictures are put on.
struct Grid {
    left: f64,
    top: f64,
    /// Width and height of a pixel, units of the CRS.
    pixel: (f64, f64),
    size_px: (u64, u64),
}

impl Grid {
    fn of(
        path: &Path,
        files: &[PathBuf],
        pictures: &[(Georeference, (u64, u64))],
    ) -> Result<Self, GeoError> {
        let unsupported = |file: &Path, what: String| GeoError::Unsupported {
            path: file.to_path_buf(),
            what,
            advice: "bring all of them into one coordinate system, north up: gdalwarp -t_srs EPSG:CODE IN OUT.tif",
        };
        let Some((first, _)) = pictures.first() else {
            return Err(GeoError::NotAMap {
                path: path.to_path_buf(),
                reason: "it lists no GeoTIFFs".to_string(),
            });
        };
        let mut grid = Self {
            left: f64::INFINITY,
            top: f64::NEG_INFINITY,
            pixel: (f64::INFINITY, f64::INFINITY),
            size_px: (0, 0),
        };
        let (mut right, mut bottom) = (f64::NEG_INFINITY, f64::INFINITY);
        for (file, (place, size_px)) in files.iter().zip(pictures) {
            if place.crs() != first.crs() {
                return Err(unsupported(
                    file,
                    format!(
                        "coordinate system {} beside {} of {}",
                        place.crs(),
                        first.crs(),
                        files[0].display()
                    ),
                ));
            }
            let [x, width, skew_x, y, skew_y, height] = place.affine().to_gdal();
            if skew_x != 0.0 || skew_y != 0.0 || width <= 0.0 || height >= 0.0 {
                return Err(unsupported(
                    file,
                    "a picture that is not north up".to_string(),
                ));
            }
            grid.left = grid.left.min(x);
            grid.top = grid.top.max(y);
            right = right.max(x + width * size_px.0 as f64);
            bottom = bottom.min(y + height * size_px.1 as f64);
            grid.pixel = (grid.pixel.0.min(width), grid.pixel.1.min(-height));
        }
        let count = |length: f64, pixel: f64| {
            ((length / pixel - WHOLE_PIXEL_TOLERANCE).ceil() as u64).max(1)
        };
        grid.size_px = (
            count(right - grid.left, grid.pixel.0),
            count(grid.top - bottom, grid.pixel.1),
        );
        Ok(grid)
    }

    fn affine(&self, path: &Path) -> Result<Affine, GeoError> {
        Affine::from_gdal([self.left, self.pixel.0, 0.0, self.top, 0.0, -self.pixel.1])
            .map_err(|e| e.in_file(path))
    }

    /// Where a picture lies, pixels of the grid.
    fn place(&self, place: &Georeference, size_px: (u64, u64)) -> WindowPx {
        let [x, width, _, y, _, height] = place.affine().to_gdal();
        let side = |count: u64, pixel: f64, grid: f64| {
            let scale = pixel / grid;
            if (scale - 1.0).abs() < SIZE_TOLERANCE {
                count as f64
            } else {
                count as f64 * scale
            }
        };
        WindowPx::new(
            snapped((x - self.left) / self.pixel.0),
            snapped((self.top - y) / self.pixel.1),
            side(size_px.0, width, self.pixel.0),
            side(size_px.1, -height, self.pixel.1),
        )
    }
}

fn snapped(px: f64) -> f64 {
    if (px - px.round()).abs() < WHOLE_PIXEL_TOLERANCE {
        px.round()
    } else {
        px
    }
}

/// Pictures with their places, and the files they are made of.
#[derive(Default)]
struct Members {
    members: Vec<Member>,
    files: Vec<PathBuf>,
    open: Arc<OpenFiles>,
}

impl Members {
    fn add(
        &mut self,
        file: &Path,
        nodata: Option<f64>,
        opened: &dyn BlockSource,
        files: Vec<PathBuf>,
        from: WindowPx,
        to: WindowPx,
    ) {
        let id = self.members.len();
        let layouts = opened.levels().to_vec();
        let file = SourceFile::new(id, file, nodata, layouts, Arc::clone(&self.open));
        self.members.push(Member { file, from, to });
        self.files.extend(files);
    }

    fn map(
        self,
        path: &Path,
        kind: String,
        place: Georeference,
        size_px: (u64, u64),
        cache: Arc<BlockCache>,
    ) -> SingleMap {
        let mut files = self.files;
        if !path.is_dir() {
            files.insert(0, path.to_path_buf());
        }
        files.dedup();
        let mosaic = Mosaic::new(self.members, size_px);
        SingleMap::new(path, Box::new(mosaic), kind, place, files, cache)
    }
}

/// A file that can be read from any position: opening anything else may block.
fn regular(path: &Path) -> Result<&Path, GeoError> {
    let metadata = std::fs::metadata(path).map_err(|e| GeoError::io(path, e))?;
    if metadata.is_file() {
        return Ok(path);
    }
    Err(GeoError::NotAMap {
        path: path.to_path_buf(),
        reason: "it is not a file".to_string(),
    })
}

/// The GeoTIFFs in a folder, in order of their names.
fn geotiffs_in(folder: &Path) -> Result<Vec<PathBuf>, GeoError> {
    let error = |e| GeoError::io(folder, e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(error)? {
        let entry = entry.map_err(error)?;
        if is_tiff_name(&entry.file_name()) && entry.path().is_file() {
            files.push(entry.path());
        }
    }
    files.sort();
    check_count(folder, files.len())?;
    Ok(files)
}

/// The files of a list, relative to its folder. Empty lines and those that begin with `#` are left out.
fn listed(path: &Path) -> Result<Vec<PathBuf>, GeoError> {
    let length = std::fs::metadata(path)
        .map_err(|e| GeoError::io(path, e))?
        .len();
    if length > MAX_LIST_BYTES {
        return Err(GeoError::damaged(path, format!("it has {length} bytes")));
    }
    let text = std::fs::read_to_string(path).map_err(|e| GeoError::io(path, e))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let files: Vec<PathBuf> = text
        .trim_start_matches('\u{feff}')
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(|line| folder.join(line))
        .collect();
    check_count(path, files.len())?;
    Ok(files)
}

fn check_count(path: &Path, count: usize) -> Result<(), GeoError> {
    if count <= MAX_PICTURES {
        return Ok(());
    }
    Err(GeoError::Unsupported {
        path: path.to_path_buf(),
        what: format!("{count} pictures, more than {MAX_PICTURES}"),
        advice: "make fewer of them: gdal_translate -of COG -co COMPRESS=JPEG IN.vrt OUT.tif",
    })
}
