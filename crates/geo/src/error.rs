//! What can go wrong with a map, and what to do about it.

use std::path::{Path, PathBuf};

/// An error of this crate. Each variant that concerns a file names it and says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GeoError {
    /// The file cannot be opened or read.
    #[error("{}: cannot read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },

    /// The file is none of the formats a map can have.
    #[error(
        "{}: not a map: {reason}; give a GeoTIFF, a JPEG/PNG/WebP/TIFF picture, or a .csv that lists pictures and their corners",
        path.display()
    )]
    NotAMap {
        /// The file.
        path: PathBuf,
        /// What was found instead.
        reason: String,
    },

    /// Nothing says where on Earth the picture lies.
    #[error(
        "{}: no georeference: {reason}; give --corners LL_LON,LL_LAT,UR_LON,UR_LAT, or put a world file (.tfw, .jgw, .pgw, .wld) beside it and give --crs",
        path.display()
    )]
    NoGeoreference {
        /// The file.
        path: PathBuf,
        /// What was looked for, or what was found that cannot be used.
        reason: String,
    },

    /// There is a transform, but nothing says in which coordinate system.
    #[error("{}: no coordinate system: {reason}; give --crs EPSG:CODE or --crs '+proj=...'", path.display())]
    MissingCrs {
        /// The file.
        path: PathBuf,
        /// Where the transform was found.
        reason: String,
    },

    /// A coordinate system that is not known or not supported.
    #[error(
        "unknown coordinate system '{crs}': {reason}; give EPSG:CODE (for example EPSG:32651) or a PROJ string ('+proj=utm +zone=51 +datum=WGS84')"
    )]
    UnknownCrs {
        /// As it was written.
        crs: String,
        /// Why it cannot be used.
        reason: String,
    },

    /// The file's own coordinate system is not known or not supported.
    #[error("{}: unknown coordinate system '{crs}': {reason}; give --crs EPSG:CODE, or reproject: gdalwarp -t_srs EPSG:4326 IN OUT", path.display())]
    UnsupportedCrs {
        /// The file.
        path: PathBuf,
        /// The coordinate system, as far as it is known.
        crs: String,
        /// Why it cannot be used.
        reason: String,
    },

    /// Longitude and latitude have changed places.
    #[error("{location}: longitude and latitude look swapped: {reason}; {order}")]
    SwappedLonLat {
        /// The file and line, or the option.
        location: String,
        /// What gave it away.
        reason: String,
        /// The order that is expected.
        order: &'static str,
    },

    /// Corners that do not span a map.
    #[error("{location}: corners cannot be used: {reason}")]
    BadCorners {
        /// The file and line, or the option.
        location: String,
        /// What is wrong.
        reason: String,
    },

    /// A world file that is not six numbers or has no inverse.
    #[error("{}: not a world file: {reason}; it must hold six numbers, one a line: x size, two rotations, y size, x and y of the centre of the top-left pixel", path.display())]
    BadWorldFile {
        /// The world file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },

    /// A transform that has no inverse.
    #[error(
        "{location}: the transform from pixels to coordinates has no inverse: {coefficients:?}; expected six finite numbers (GDAL's geotransform) that span a pixel"
    )]
    SingularTransform {
        /// The file, or where the transform came from.
        location: String,
        /// The coefficients of the transform in the order of GDAL's geotransform.
        coefficients: [f64; 6],
    },

    /// A table of pictures that cannot be read.
    #[error("{}: line {line}: {reason}; the columns are filename, top_left_lat, top_left_lon, bottom_right_lat, bottom_right_lon (or LL_lon, LL_lat, UR_lon, UR_lat)", path.display())]
    BadTable {
        /// The table.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What is wrong.
        reason: String,
    },

    /// The file ends before its pixels do.
    #[error("{}: truncated: its pixels need {needed_bytes} bytes and the file has {found_bytes}; copy or download it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the last block should end.
        needed_bytes: u64,
        /// The file's size.
        found_bytes: u64,
    },

    /// The file is damaged.
    #[error("{}: damaged: {reason}; copy or download it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },

    /// The file is sound, but of a kind that is not read here.
    #[error("{}: not supported: {what}; {advice}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What it has.
        what: String,
        /// What to do.
        advice: &'static str,
    },

    /// A place that the coordinate system cannot express.
    #[error("({x}, {y}) cannot be transformed in {crs}: {reason}")]
    OutsideDomain {
        /// The coordinate system.
        crs: String,
        /// x or longitude.
        x: f64,
        /// y or latitude.
        y: f64,
        /// What the projection said.
        reason: String,
    },

    /// A window that is not finite, is empty, or asks for no pixels or too many.
    #[error("cannot read window {window}: {reason}")]
    BadWindow {
        /// The window.
        window: String,
        /// What is wrong.
        reason: String,
    },

    /// A tile grid that cannot be laid.
    #[error("cannot lay tiles: {0}")]
    BadGrid(String),
}

/// How to make a file that can be read, for the errors that need it.
pub(crate) const ADVICE_TILE_IT: &str =
    "convert it: gdal_translate -of COG -co COMPRESS=JPEG IN OUT.tif";

impl GeoError {
    /// Names the file in an error about a transform.
    pub(crate) fn in_file(self, path: &Path) -> Self {
        match self {
            Self::SingularTransform { coefficients, .. } => Self::SingularTransform {
                location: path.display().to_string(),
                coefficients,
            },
            other => other,
        }
    }

    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io {
            path: path.to_path_buf(),
            source,
        }
    }

    pub(crate) fn damaged(path: &Path, reason: impl ToString) -> Self {
        Self::Damaged {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
