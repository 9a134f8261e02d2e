//! The errors of this crate.

use std::path::{Path, PathBuf};

/// An error of opening or reading a map, or of a coordinate system. Variants about a file name it; messages say what
/// is wrong, what was expected, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GeoError {
    /// The file cannot be opened or read.
    #[error("{}: cannot read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },

    /// A list, table or VRT names a file that does not exist.
    #[error("{}: it names {}, which does not exist; put the file there, or leave it out", path.display(), file.display())]
    MissingMember {
        /// The list.
        path: PathBuf,
        /// The file that it names.
        file: PathBuf,
    },

    /// The file has none of the supported formats.
    #[error(
        "{}: not a map: {reason}; expected a GeoTIFF, a JPEG, PNG, WebP or TIFF picture, MBTiles, PMTiles, a folder of tiles or of GeoTIFFs, a .vrt, a .txt that lists GeoTIFFs, or a .csv that lists pictures and their corners",
        path.display()
    )]
    NotAMap {
        /// The file.
        path: PathBuf,
        /// What was found instead.
        reason: String,
    },

    /// The position of the picture on Earth is unknown.
    #[error(
        "{}: no georeference: {reason}; give the longitude and latitude of its lower left and upper right corners, or put a world file (.tfw, .jgw, .pgw, .wld) beside it and give its coordinate system",
        path.display()
    )]
    NoGeoreference {
        /// The file.
        path: PathBuf,
        /// What is missing, or what was found that cannot be used.
        reason: String,
    },

    /// There is a transform to coordinates, but their coordinate system is unknown.
    #[error("{}: no coordinate system: {reason}; give it as EPSG:CODE or as a PROJ string ('+proj=...')", path.display())]
    MissingCrs {
        /// The file.
        path: PathBuf,
        /// Where the transform was found.
        reason: String,
    },

    /// A coordinate system that is unknown or not supported.
    #[error(
        "unknown coordinate system '{crs}': {reason}; give EPSG:CODE (for example EPSG:32651) or a PROJ string ('+proj=utm +zone=51 +datum=WGS84')"
    )]
    UnknownCrs {
        /// The coordinate system as given.
        crs: String,
        /// Why it cannot be used.
        reason: String,
    },

    /// The coordinate system in the file is unknown or not supported.
    #[error("{}: the coordinate system '{crs}' cannot be used: {reason}{}", path.display(), advice_on_crs(reason))]
    UnsupportedCrs {
        /// The file.
        path: PathBuf,
        /// The coordinate system, as far as it is known.
        crs: String,
        /// Why it cannot be used.
        reason: String,
    },

    /// Longitude and latitude are probably swapped.
    #[error("{location}: longitude and latitude look swapped: {reason}; {order}")]
    SwappedLonLat {
        /// The file and line, or the option.
        location: String,
        /// How this was detected.
        reason: String,
        /// The order that is expected.
        order: &'static str,
    },

    /// Corners that do not span a map.
    #[error("{location}: invalid corners: {reason}")]
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

    /// The map shows the ground mirrored.
    #[error(
        "{}: its pixels are mirrored (rows run from south to north, or columns from east to west); turn it: gdalwarp IN OUT.tif",
        path.display()
    )]
    Mirrored {
        /// The map.
        path: PathBuf,
    },

    /// A table of pictures that is invalid.
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
    #[error("{}: truncated: it needs {needed_bytes} bytes or more and has {found_bytes}; copy or download it again", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the last block ends, or the part that was looked for, bytes from the start of the file.
        needed_bytes: u64,
        /// The file's size.
        found_bytes: u64,
    },

    /// The file is damaged.
    #[error("{}: damaged: {reason}; copy or download it again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The message of the decoder.
        reason: String,
    },

    /// The file is valid, but uses a feature that is not supported.
    #[error("{}: not supported: {what}; {advice}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The feature.
        what: String,
        /// What to do.
        advice: &'static str,
    },

    /// A map of tiles does not have the zoom that was asked for.
    #[error("{}: no tiles of zoom {zoom}; {}", path.display(), list(zooms))]
    NoSuchZoom {
        /// The file or folder.
        path: PathBuf,
        /// As given.
        zoom: u8,
        /// Zooms with tiles.
        zooms: Vec<u8>,
    },

    /// A position outside the domain of the coordinate system.
    #[error("({x}, {y}) cannot be transformed in {crs}: {reason}")]
    OutsideDomain {
        /// The coordinate system.
        crs: String,
        /// x or longitude.
        x: f64,
        /// y or latitude.
        y: f64,
        /// Why it cannot be transformed.
        reason: String,
    },

    /// A window that is not finite, is empty or too large, or whose output has no pixels or too many.
    #[error("cannot read window {window}: {reason}")]
    BadWindow {
        /// The window.
        window: String,
        /// What is wrong.
        reason: String,
    },

    /// A ground resolution that is not a positive number.
    #[error("{gsd_m} m per pixel is not a ground resolution; expected a positive number")]
    BadResolution {
        /// As given, metres per pixel.
        gsd_m: f64,
    },
}

/// How to make a file that can be read, for the errors that need it. JPEG has no samples of more than 8 bits, nor grey with alpha.
pub(crate) const ADVICE_TILE_IT: &str =
    "convert it: gdal_translate -of COG -co COMPRESS=DEFLATE IN OUT.tif";

/// How to make a file whose samples can be read.
pub(crate) const ADVICE_SAMPLES: &str =
    "convert it: gdal_translate -ot Float32 -of COG -co COMPRESS=DEFLATE IN OUT.tif";

impl GeoError {
    /// Whether the map can be read if its coordinate system is given ([`MapOptions::crs`](crate::MapOptions::crs)).
    #[must_use]
    pub fn asks_for_crs(&self) -> bool {
        match self {
            Self::MissingCrs { .. } => true,
            Self::UnsupportedCrs { reason, .. } => !must_be_reprojected(reason),
            _ => false,
        }
    }
}

/// Whether a coordinate system is known and cannot be read, so that the map would only be elsewhere under the code of another: the reason
/// then says how to reproject it.
fn must_be_reprojected(reason: &str) -> bool {
    reason.contains("gdalwarp")
}

/// What to do about a coordinate system in a file, unless the reason says it.
fn advice_on_crs(reason: &str) -> &'static str {
    if must_be_reprojected(reason) {
        ""
    } else {
        "; give the coordinate system as EPSG:CODE, or reproject the map: gdalwarp -t_srs EPSG:4326 IN OUT"
    }
}

fn list(zooms: &[u8]) -> String {
    if zooms.is_empty() {
        return "it is not a map of tiles: give no zoom".to_string();
    }
    let zooms: Vec<String> = zooms.iter().map(u8::to_string).collect();
    format!("it has the zooms {}", zooms.join(", "))
}

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

    /// The same error of a file that `list` names: says where the name of one comes from that does not exist.
    pub(crate) fn of_member(self, list: &Path) -> Self {
        match self {
            Self::Io { path: file, source } if source.kind() == std::io::ErrorKind::NotFound => {
                Self::MissingMember {
                    path: list.to_path_buf(),
                    file,
                }
            }
            other => other,
        }
    }

    pub(crate) fn damaged(path: &Path, reason: impl ToString) -> Self {
        Self::Damaged {
            path: path.to_path_buf(),
            reason: reason.to_string(),
        }
    }
}
