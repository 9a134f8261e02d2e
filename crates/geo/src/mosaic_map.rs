//! A VRT, a list or a folder of GeoTIFFs as one map.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use grimnet_limits::MapLimits;

use crate::block::BlockSource;
use crate::block_cache::BlockCache;
use crate::content_hash::{ContentHash, ContentValues};
use crate::error::ADVICE_TILE_IT;
use crate::map_form::is_tiff_name;
use crate::map_options::MapOptions;
use crate::mosaic::{Member, Mosaic};
use crate::mosaic_grid::MosaicGrid;
use crate::placing::{corners_georeference, georeference, place_tiff, stated_elsewhere};
use crate::sidecar_values::SidecarValues;
use crate::single_map::SingleMap;
use crate::source_file::{OpenFiles, Source, SourceFile};
use crate::stated_crs::StatedCrs;
use crate::text_file::read_text;
use crate::tiff::TiffMap;
use crate::vrt::read_vrt;
use crate::{Crs, GeoError, Georeference, WindowPx};

/// Pictures, at most.
const MAX_PICTURES: usize = MapLimits::DEFAULT.max_mosaic_pictures as usize;
/// Largest list that is read, bytes.
const MAX_LIST_BYTES: u64 = MapLimits::DEFAULT.max_description_bytes;

/// Opens a VRT.
pub(crate) fn open_vrt(
    path: &Path,
    crs: Option<Crs>,
    options: &MapOptions,
    cache: Arc<BlockCache>,
) -> Result<SingleMap, GeoError> {
    let vrt = read_vrt(path)?;
    let mut members = Members::default();
    vrt.add_to(&mut members.values);
    for source in &vrt.sources {
        let file = regular(path, &source.file)?;
        let opened = Source::open(file, source.nodata)?;
        if vrt.is_grey && !opened.is_grey() {
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
        let sidecars = SidecarValues {
            nodata: opened.nodata_beside(),
            ..SidecarValues::default()
        };
        members.add(file, &opened, source.nodata, &sidecars);
    }
    let mut own_crs = vrt.crs.clone();
    if own_crs == StatedCrs::Absent
        && let Some(first) = vrt.sources.first()
        && let Ok(map) = TiffMap::open(&first.file)
        && let Ok(placed) = place_tiff(&first.file, &map, None, &MapOptions::default())
    {
        // gdalbuildvrt demands that all pictures have the same system.
        own_crs = StatedCrs::Known(placed.georeference.crs().clone());
        placed.sidecars.add_to(&mut members.values);
    }
    let by_vrt = |crs: StatedCrs| {
        let affine = vrt.affine.ok_or_else(|| GeoError::NoGeoreference {
            path: path.to_path_buf(),
            reason: "the VRT has no GeoTransform".to_string(),
        })?;
        let crs = crs.in_file(path)?.ok_or_else(|| GeoError::MissingCrs {
            path: path.to_path_buf(),
            reason: "neither the VRT nor its first picture has one".to_string(),
        })?;
        georeference(path, affine, crs.into(), vrt.size_px)
    };
    let place = match corners_georeference(&crs, options, vrt.size_px)? {
        Some(place) => place,
        None => by_vrt(
            crs.clone()
                .map_or_else(|| own_crs.clone(), StatedCrs::Known),
        )?,
    };
    let caveat = match by_vrt(own_crs) {
        Ok(stated) if crs.is_some() || options.corners.is_some() => {
            stated_elsewhere(&stated, &place)
        }
        _ => None,
    };
    let kind = format!("VRT of {} pictures", vrt.sources.len());
    let windows = vrt.sources.iter().map(|source| (source.from, source.to));
    let map = members.map(path, kind, place, vrt.size_px, windows, cache);
    Ok(map.with_caveats(caveat))
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
    let mut members = Members::default();
    if !path.is_dir() {
        members.files.push(path.to_path_buf());
    }
    let mut caveat = None;
    for file in &files {
        let file = regular(path, file)?;
        let opened = Source::open(file, None)?;
        let Source::Tiff(map) = &opened else {
            return Err(GeoError::Unsupported {
                path: file.to_path_buf(),
                what: "a picture that is no GeoTIFF, among several".to_string(),
                advice: ADVICE_TILE_IT,
            });
        };
        let placed = place_tiff(file, map, crs.clone(), options)?;
        caveat = caveat.or_else(|| {
            let first = placed.caveats.first()?;
            Some(format!("{}: {first}", file.display()))
        });
        members.add(file, &opened, None, &placed.sidecars);
        pictures.push((placed.georeference, map.size_px()));
    }
    let grid = MosaicGrid::of(path, &files, &pictures)?;
    let kind = format!("{} GeoTIFFs", files.len());
    let crs = pictures[0].0.crs().clone();
    let place = georeference(path, grid.affine(path)?, crs.into(), grid.size_px)?;
    let windows = pictures.iter().map(|(place, size_px)| {
        let whole = WindowPx::new(0.0, 0.0, size_px.0 as f64, size_px.1 as f64);
        (whole, grid.place(place, *size_px))
    });
    let map = members.map(path, kind, place, grid.size_px, windows, cache);
    Ok(map.with_caveats(caveat))
}

/// The pictures of a mosaic, lowest first, and their content.
#[derive(Default)]
struct Members {
    pictures: Vec<SourceFile>,
    files: Vec<PathBuf>,
    values: ContentValues,
    open: Arc<OpenFiles>,
}

impl Members {
    /// Adds a picture; `nodata` takes the place of its own, and `sidecars` are what is taken from files beside it.
    fn add(&mut self, path: &Path, opened: &Source, nodata: Option<f64>, sidecars: &SidecarValues) {
        let id = self.pictures.len();
        if *sidecars != SidecarValues::default() {
            self.values.add_numbers("picture", &[id as f64]);
            sidecars.add_to(&mut self.values);
        }
        // The value as it is now, should the picture be opened again after its sidecar has changed.
        let nodata = nodata.or(sidecars.nodata);
        let layouts = opened.levels().to_vec();
        let file = SourceFile::new(id, path, nodata, layouts, Arc::clone(&self.open));
        self.pictures.push(file);
        self.files.extend(opened.files(path));
    }

    /// The map of them; `windows` are the part of each that is shown, and where.
    fn map(
        self,
        path: &Path,
        kind: String,
        place: Georeference,
        size_px: (u64, u64),
        windows: impl Iterator<Item = (WindowPx, WindowPx)>,
        cache: Arc<BlockCache>,
    ) -> SingleMap {
        let mut files = self.files;
        files.dedup();
        let members = self.pictures.into_iter().zip(windows);
        let members = members
            .map(|(file, (from, to))| Member { file, from, to })
            .collect();
        let mosaic = Box::new(Mosaic::new(members, size_px));
        let hash = ContentHash::of(files).with_values(self.values);
        SingleMap::new(path, mosaic, kind, place, hash, cache)
    }
}

/// A file of `list` that can be read from any position: opening anything else may block.
fn regular<'a>(list: &Path, file: &'a Path) -> Result<&'a Path, GeoError> {
    let metadata = std::fs::metadata(file).map_err(|e| GeoError::io(file, e).of_member(list))?;
    if metadata.is_file() {
        return Ok(file);
    }
    Err(GeoError::NotAMap {
        path: file.to_path_buf(),
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

/// The files of a list, relative to its folder; names may stand in quotation marks. Empty lines and those that begin with `#` are left
/// out.
fn listed(path: &Path) -> Result<Vec<PathBuf>, GeoError> {
    let length = std::fs::metadata(path)
        .map_err(|e| GeoError::io(path, e))?
        .len();
    if length > MAX_LIST_BYTES {
        return Err(GeoError::damaged(path, format!("it has {length} bytes")));
    }
    let text = read_text(path, || GeoError::Unsupported {
        path: path.to_path_buf(),
        what: "a list that is not UTF-8 text".to_string(),
        advice: "save it as UTF-8",
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let files: Vec<PathBuf> = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(|line| folder.join(without_quotes(line)))
        .collect();
    check_count(path, files.len())?;
    Ok(files)
}

/// A name without the quotation marks around it, which Windows writes when a path is copied.
fn without_quotes(line: &str) -> &str {
    let inner = line
        .strip_prefix('"')
        .and_then(|rest| rest.strip_suffix('"'));
    inner.unwrap_or(line)
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
