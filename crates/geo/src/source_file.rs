//! Pictures of a mosaic, opened when they are needed.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::GeoError;
use crate::block::{Block, BlockLayout, BlockSource};
use crate::error::ADVICE_TILE_IT;
use crate::map_form::{MapForm, form_of};
use crate::picture::Picture;
use crate::tiff::TiffMap;

/// Files that are open at once: systems allow a process about a thousand.
const MAX_OPEN: usize = 128;

/// An open source, and the number of its file.
type Open = (usize, Arc<dyn BlockSource>);

/// The files of a mosaic that are open, the most recently used last.
#[derive(Default)]
pub(crate) struct OpenFiles(Mutex<VecDeque<Open>>);

/// A picture in a file that is opened when it is needed.
pub(crate) struct SourceFile {
    id: usize,
    path: PathBuf,
    nodata: Option<f64>,
    layouts: Vec<BlockLayout>,
    open: Arc<OpenFiles>,
}

impl SourceFile {
    /// A file with its sizes; `nodata` takes the place of the file's own.
    pub fn new(
        id: usize,
        path: &Path,
        nodata: Option<f64>,
        layouts: Vec<BlockLayout>,
        open: Arc<OpenFiles>,
    ) -> Self {
        Self {
            id,
            path: path.to_path_buf(),
            nodata,
            layouts,
            open,
        }
    }

    fn source(&self) -> Result<Arc<dyn BlockSource>, GeoError> {
        let held = {
            let mut open = self.open.0.lock().unwrap_or_else(PoisonError::into_inner);
            let at = open.iter().position(|(id, _)| *id == self.id);
            let held = at.and_then(|at| open.remove(at));
            if let Some(held) = &held {
                open.push_back((held.0, Arc::clone(&held.1)));
            }
            held
        };
        if let Some((_, source)) = held {
            return Ok(source);
        }
        let (source, _) = open_source(&self.path, self.nodata)?;
        let source: Arc<dyn BlockSource> = Arc::from(source);
        if source.levels() != self.layouts {
            return Err(GeoError::damaged(
                &self.path,
                "it changed while the map was open",
            ));
        }
        let mut open = self.open.0.lock().unwrap_or_else(PoisonError::into_inner);
        if open.len() >= MAX_OPEN {
            open.pop_front();
        }
        open.push_back((self.id, Arc::clone(&source)));
        Ok(source)
    }
}

impl BlockSource for SourceFile {
    fn levels(&self) -> &[BlockLayout] {
        &self.layouts
    }

    fn decode(&self, level: usize, column: u64, row: u64) -> Result<Block, GeoError> {
        self.source()?.decode(level, column, row)
    }
}

/// What a picture brings with it.
pub(crate) struct SourceFacts {
    /// Files that its pixels are made of.
    pub files: Vec<PathBuf>,
    /// Whether it has colours.
    pub is_grey: bool,
}

/// Opens a picture of a mosaic.
pub(crate) fn open_source(
    path: &Path,
    nodata: Option<f64>,
) -> Result<(Box<dyn BlockSource>, SourceFacts), GeoError> {
    let unsupported = |what: &str, advice| GeoError::Unsupported {
        path: path.to_path_buf(),
        what: what.to_string(),
        advice,
    };
    match form_of(path)? {
        MapForm::Tiff => {
            let mut map = TiffMap::open(path)?;
            if !map.is_8_bit() {
                return Err(unsupported(
                    "samples that are not 8-bit, in a map of several pictures: they would be stretched one by one, with seams",
                    "convert the whole map with one scale: gdal_translate -ot Byte -scale MIN MAX 0 255 IN.vrt OUT.tif",
                ));
            }
            if nodata.is_some() {
                map.set_nodata(nodata);
            }
            let facts = SourceFacts {
                files: map.images().files.clone(),
                is_grey: map.is_grey(),
            };
            Ok((Box::new(map), facts))
        }
        MapForm::Picture if nodata.is_none() => {
            let facts = SourceFacts {
                files: vec![path.to_path_buf()],
                is_grey: false,
            };
            Ok((Box::new(Picture::open(path)?), facts))
        }
        MapForm::Picture => Err(unsupported(
            "a nodata value for a picture that is no GeoTIFF",
            ADVICE_TILE_IT,
        )),
        _ => Err(unsupported(
            "a map within a map",
            "expected GeoTIFFs or pictures: make one map of it first: gdal_translate IN OUT.tif",
        )),
    }
}
