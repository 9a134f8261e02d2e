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
type Open = (usize, Arc<Source>);

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

    fn source(&self) -> Result<Arc<Source>, GeoError> {
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
        let source = Arc::new(Source::open(&self.path, self.nodata)?);
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

/// A picture of a mosaic.
pub(crate) enum Source {
    Tiff(Box<TiffMap>),
    Picture(Picture),
}

impl Source {
    /// Opens a picture; `nodata` takes the place of its own.
    pub fn open(path: &Path, nodata: Option<f64>) -> Result<Self, GeoError> {
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
                if let Some(nodata) = nodata {
                    map.set_nodata(nodata);
                }
                Ok(Self::Tiff(Box::new(map)))
            }
            MapForm::Picture if nodata.is_none() => Picture::open(path).map(Self::Picture),
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

    /// Files that the pixels of the picture at `path` are made of.
    pub fn files(&self, path: &Path) -> Vec<PathBuf> {
        match self {
            Self::Tiff(map) => map.images().files.clone(),
            Self::Picture(_) => vec![path.to_path_buf()],
        }
    }

    /// Whether it has no colours.
    pub fn is_grey(&self) -> bool {
        match self {
            Self::Tiff(map) => map.is_grey(),
            Self::Picture(picture) => picture.is_grey(),
        }
    }

    /// The value of pixels without data, if it is one of a file beside the picture.
    pub fn nodata_beside(&self) -> Option<f64> {
        match self {
            Self::Tiff(map) => map.nodata_beside(),
            Self::Picture(_) => None,
        }
    }
}

impl BlockSource for Source {
    fn levels(&self) -> &[BlockLayout] {
        match self {
            Self::Tiff(map) => map.levels(),
            Self::Picture(picture) => picture.levels(),
        }
    }

    fn decode(&self, level: usize, column: u64, row: u64) -> Result<Block, GeoError> {
        match self {
            Self::Tiff(map) => map.decode(level, column, row),
            Self::Picture(picture) => picture.decode(level, column, row),
        }
    }
}
