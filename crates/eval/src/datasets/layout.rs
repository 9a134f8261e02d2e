//! Recognises the layout of a folder and reads map, photos and truth from it.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use grimnet_geo::{GeoError, MapOptions, Raster, open_map};
use grimnet_locate::Prior;
use grimnet_photo::{Metadata, PhotoLimits};

use super::anyvisloc::{self, AnyVisLocError};
use super::msdi;
use super::truth::{self, TruthError, TruthFrame};
use super::visloc::{self, VislocError};
use crate::scene::{PhotoSource, Scene, Shot, TRUE_HEADING_SIGMA_DEG, Truth};
use grimnet_photo::pictures::{EXTENSIONS, file_name, picture_files};

/// Which data set to read, and how.
#[derive(Debug, Clone)]
pub struct DataSetRequest<'a> {
    /// The folder.
    pub folder: &'a Path,
    /// The map, if it is not at its usual place in the folder.
    pub map: Option<&'a Path>,
    /// Georeference of the map, if its file has none.
    pub map_options: MapOptions,
    /// Where files are written that the data set has in another form: photos (AnyVisLoc), a map in parts (UAV-VisLoc).
    pub scratch: &'a Path,
    /// Limits within which photos are read.
    pub photo_limits: PhotoLimits,
}

/// A data set as read from its folder.
#[derive(Debug, Clone)]
pub struct DataSet {
    /// Description for people, such as "UAV-VisLoc 03".
    pub name: String,
    /// The map.
    pub map: PathBuf,
    /// Georeference of the map, if its file has none.
    pub map_options: MapOptions,
    /// The photos with a known position.
    pub frames: Vec<(TruthFrame, PathBuf)>,
    /// Other files that were read: tables of positions and corners, archives of photos.
    pub other_files: Vec<PathBuf>,
    /// Limits within which the photos are read.
    pub photo_limits: PhotoLimits,
}

/// Why a data set cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DataSetError {
    /// The folder does not exist.
    #[error("{0}: no such folder")]
    NoFolder(PathBuf),
    /// The truth file.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A scene of UAV-VisLoc.
    #[error(transparent)]
    Visloc(#[from] VislocError),
    /// A scene of AnyVisLoc.
    #[error(transparent)]
    AnyVisLoc(#[from] AnyVisLocError),
    /// A folder cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The map cannot be read.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// MSDI without a map.
    #[error("{0}: MSDI comes without a map of its flights; a map that covers them is required")]
    MsdiNeedsMap(PathBuf),
    /// Neither a known layout nor a map for photos with a position in their EXIF.
    #[error(
        "{0}: no truth.csv, not a scene of UAV-VisLoc or AnyVisLoc; photos with a position in their EXIF need a map"
    )]
    UnknownLayout(PathBuf),
    /// The folder has no pictures.
    #[error("{folder}: no photos (looked for {})", EXTENSIONS.join(", "))]
    NoPhotos {
        /// The folder.
        folder: PathBuf,
    },
    /// No photo has a known position.
    #[error("{0}: no photo with a known position")]
    NoTruth(PathBuf),
    /// No true position is on the map.
    #[error(
        "none of the {count} true positions is on the map (the first is latitude {lat_deg}, longitude {lon_deg}; the map: {map}); check the \
         map's coordinate system and corners, and the columns of latitude and longitude"
    )]
    OffMap {
        /// Number of true positions.
        count: usize,
        /// Latitude of the first, degrees.
        lat_deg: f64,
        /// Longitude of the first, degrees.
        lon_deg: f64,
        /// Description of the map.
        map: String,
    },
}

impl DataSet {
    /// Reads the data set in a folder. Photos that cannot be scored are logged as warnings and skipped.
    ///
    /// # Errors
    /// Returns an error if the folder has no known layout, or no photo with a known position.
    pub fn find(request: &DataSetRequest<'_>) -> Result<Self, DataSetError> {
        let folder = request.folder;
        if !folder.is_dir() {
            return Err(DataSetError::NoFolder(folder.to_owned()));
        }
        if has_truth_file(folder) {
            Self::plain(request)
        } else if visloc::is_scene(folder) {
            Self::visloc(request)
        } else if anyvisloc::is_scene(folder) {
            Self::anyvisloc(request)
        } else {
            tracing::warn!(
                "{}: no {TRUTH_FILE}; the truth is the receiver's position in the photos' EXIF, {NOT_THE_CENTRE}",
                folder.display()
            );
            Self::by_exif(request)
        }
    }

    /// Returns whether a folder is recognised as a data set by its files alone.
    #[must_use]
    pub fn is_recognised(folder: &Path) -> bool {
        has_truth_file(folder) || visloc::is_scene(folder) || anyvisloc::is_scene(folder)
    }

    /// Folders of the scenes in a folder, in order: those of MSDI, or each subfolder that is recognised as a data set; the folder itself
    /// if it is one data set.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn scenes(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
        if !Self::is_recognised(folder) {
            if let Some(scenes) = msdi::scenes(folder) {
                return Ok(scenes);
            }
            let mut scenes: Vec<PathBuf> = fs_err::read_dir(folder)?
                .filter_map(|entry| entry.ok().map(|e| e.path()))
                .filter(|path| Self::is_recognised(path))
                .collect();
            scenes.sort();
            if !scenes.is_empty() {
                return Ok(scenes);
            }
        }
        Ok(vec![folder.to_owned()])
    }

    /// The files that the data set is made of; of its map the one that names it ([`Raster::files`] has the others).
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let photos = self.frames.iter().map(|(_, path)| path.as_path());
        let others = self.other_files.iter().map(PathBuf::as_path);
        std::iter::once(self.map.as_path())
            .chain(others)
            .chain(photos)
    }

    /// Opens the map of the data set.
    ///
    /// # Errors
    /// The map cannot be read or has no georeference.
    pub fn open_map(&self) -> Result<Box<dyn Raster>, GeoError> {
        open_map(&self.map, &self.map_options)
    }

    /// The photos of the data set on `map`. Photos whose true position is off the map are logged as warnings and skipped.
    ///
    /// # Errors
    /// Returns an error if no true position is on the map: its georeference then differs from the truth's.
    pub fn into_scene(self, map: Box<dyn Raster>) -> Result<Scene, DataSetError> {
        let (on, off): (Vec<_>, Vec<_>) = self
            .frames
            .into_iter()
            .filter_map(|(frame, path)| shot(frame, path, self.photo_limits))
            .partition(|shot| is_on(map.as_ref(), shot));
        let Some(first) = on.first().or(off.first()) else {
            return Err(DataSetError::NoTruth(self.map));
        };
        if on.is_empty() {
            return Err(DataSetError::OffMap {
                count: off.len(),
                lat_deg: first.truth.position.lat_deg,
                lon_deg: first.truth.position.lon_deg,
                map: map.describe(),
            });
        }
        for shot in &off {
            tracing::warn!("{}: its true position is off the map; skipped", shot.name);
        }
        Ok(Scene {
            name: self.name,
            map,
            shots: on,
        })
    }

    /// `map.tif`, `photos/`, `truth.csv`.
    fn plain(request: &DataSetRequest<'_>) -> Result<Self, DataSetError> {
        let folder = request.folder;
        let (frames, bad) = truth::read_rows(&folder.join(TRUTH_FILE))?;
        for error in bad {
            tracing::warn!("{error}; skipped");
        }
        let frames = scorable(frames, &folder.join(PHOTO_FOLDER))?;
        let mut name = file_name(folder);
        let is_of_receiver =
            |(frame, _): &&(TruthFrame, PathBuf)| frame.centre_lat_lon_deg.is_none();
        let of_receiver = frames.iter().filter(is_of_receiver).count();
        if of_receiver > 0 {
            let share = format!("{of_receiver} of {} photos", frames.len());
            tracing::warn!(
                "{name}: the truth of {share} is the receiver's position, {NOT_THE_CENTRE}"
            );
            name += &format!(" (truth of {share}: receiver position)");
        }
        Ok(Self {
            name,
            map: request
                .map
                .map_or_else(|| folder.join(MAP_FILE), Path::to_owned),
            map_options: request.map_options.clone(),
            frames,
            other_files: vec![folder.join(TRUTH_FILE)],
            photo_limits: request.photo_limits,
        })
    }

    /// A scene of UAV-VisLoc.
    fn visloc(request: &DataSetRequest<'_>) -> Result<Self, DataSetError> {
        let scene = visloc::read(request.folder, request.scratch)?;
        for line in &scene.left_out {
            tracing::warn!("{line}");
        }
        let map_options = request.map_options.clone();
        // The scene's table tells where its own map lies, and nothing of another.
        let is_own = request.map.is_none_or(|map| is_same_file(map, &scene.map));
        let own_corners = is_own.then_some(scene.corners);
        Ok(Self {
            name: format!("UAV-VisLoc {}", file_name(request.folder)),
            map: request.map.map_or(scene.map, Path::to_owned),
            map_options: MapOptions {
                corners: map_options.corners.or(own_corners),
                ..map_options
            },
            frames: scorable(scene.frames, &scene.photos)?,
            other_files: scene.tables,
            photo_limits: request.photo_limits,
        })
    }

    /// A scene of AnyVisLoc, whose photos are written as files.
    fn anyvisloc(request: &DataSetRequest<'_>) -> Result<Self, DataSetError> {
        let scene = anyvisloc::read(request.folder, request.map, request.scratch)?;
        for line in &scene.left_out {
            tracing::warn!("{line}");
        }
        Ok(Self {
            name: format!("AnyVisLoc {}", file_name(request.folder)),
            map: scene.map,
            map_options: MapOptions {
                corners: Some(scene.corners),
                ..MapOptions::default()
            },
            frames: scorable(scene.frames, request.scratch)?,
            other_files: scene.sources,
            photo_limits: request.photo_limits,
        })
    }

    /// Photos with a position in their EXIF: that of the receiver, not of the image centre.
    fn by_exif(request: &DataSetRequest<'_>) -> Result<Self, DataSetError> {
        let folder = request.folder;
        let inside = folder.join(MAP_FILE);
        let scenes = msdi::scenes(folder);
        let Some(map) = request
            .map
            .or_else(|| inside.is_file().then_some(inside.as_path()))
        else {
            return Err(match scenes {
                Some(_) => DataSetError::MsdiNeedsMap(folder.to_owned()),
                None => DataSetError::UnknownLayout(folder.to_owned()),
            });
        };
        let photos = folder.join(PHOTO_FOLDER);
        let sources = match scenes {
            Some(scenes) => scenes,
            None if photos.is_dir() => vec![photos],
            None => vec![folder.to_owned()],
        };
        let mut frames = Vec::new();
        for source in &sources {
            let mut found = picture_files(source)?;
            // The map may lie among the photos.
            found.retain(|path| !is_same_file(path, map));
            if found.is_empty() {
                return Err(DataSetError::NoPhotos {
                    folder: source.clone(),
                });
            }
            // Folders of a camera have files of the same names.
            let of_scene = (sources.len() > 1).then(|| file_name(source));
            frames.extend(found.into_iter().filter_map(|path| {
                frame_from_exif(path, of_scene.as_deref(), &request.photo_limits)
            }));
        }
        if frames.is_empty() {
            return Err(DataSetError::NoTruth(folder.to_owned()));
        }
        Ok(Self {
            name: format!("{} (truth: receiver position in EXIF)", file_name(folder)),
            map: map.to_owned(),
            map_options: request.map_options.clone(),
            frames,
            other_files: Vec::new(),
            photo_limits: request.photo_limits,
        })
    }
}

/// Name of the program's own truth file.
const TRUTH_FILE: &str = "truth.csv";
/// Name of the map beside it.
const MAP_FILE: &str = "map.tif";
/// Name of the folder of photos beside it.
const PHOTO_FOLDER: &str = "photos";

/// What it means that a truth is the receiver's position.
const NOT_THE_CENTRE: &str =
    "not the image centre: its own error and the tilt of the camera count as errors";

/// A photo with the position in its EXIF; its name begins with that of its scene where there are several.
fn frame_from_exif(
    path: PathBuf,
    scene: Option<&str>,
    limits: &PhotoLimits,
) -> Option<(TruthFrame, PathBuf)> {
    let Ok(metadata) = Metadata::read_within(&path, limits) else {
        tracing::warn!("{}: cannot be read; skipped", path.display());
        return None;
    };
    let Some(position) = metadata.position else {
        tracing::warn!("{}: no position in its EXIF; skipped", path.display());
        return None;
    };
    let name = file_name(&path);
    let frame = TruthFrame {
        photo: scene.map_or_else(|| name.clone(), |scene| format!("{scene}/{name}")),
        gps_lat_lon_deg: Some((position.lat_deg, position.lon_deg)),
        ..TruthFrame::default()
    };
    Some((frame, path))
}

/// A photo file with its truth; `None` if the truth has no position.
fn shot(frame: TruthFrame, path: PathBuf, limits: PhotoLimits) -> Option<Shot> {
    let known = Prior::none();
    Some(Shot {
        truth: Truth {
            position: frame.position()?,
            receiver: frame.receiver(),
            error_m: frame.truth_error_m,
            place: frame.place,
            featureless_share: frame.featureless_share,
            tilt_deg: frame.tilt_deg,
        },
        name: frame.photo,
        photo: PhotoSource::File { path, limits },
        known: frame.heading_deg.map_or(known, |heading_deg| {
            known.with_heading(heading_deg, TRUE_HEADING_SIGMA_DEG)
        }),
        footprint_width_m: frame.footprint_width_m,
    })
}

fn is_on(map: &dyn Raster, shot: &Shot) -> bool {
    let (width, height) = map.size_px();
    map.georeference()
        .map_px_from_lonlat(shot.truth.position)
        .is_ok_and(|px| {
            (0.0..=width as f64).contains(&px.x) && (0.0..=height as f64).contains(&px.y)
        })
}

/// Whether a folder has a truth file. One that cannot be read, as behind a broken link, is an error where it is read, and not another truth.
fn has_truth_file(folder: &Path) -> bool {
    folder.join(TRUTH_FILE).symlink_metadata().is_ok()
}

/// Photos of one fault that are named; more are counted.
const MOST_NAMED: usize = 3;

/// The truths that can be scored: the photo exists and its position is known. All others are logged as warnings.
fn scorable(
    truth: Vec<TruthFrame>,
    photos: &Path,
) -> Result<Vec<(TruthFrame, PathBuf)>, DataSetError> {
    let (mut usable, mut listed, mut missing) = (Vec::new(), HashSet::new(), Vec::new());
    for frame in truth {
        let path = photos.join(&frame.photo);
        if !listed.insert(plain_path(&path)) {
            tracing::warn!(
                "{}: listed more than once in the truth file; the first row counts",
                frame.photo
            );
        } else if !path.is_file() {
            missing.push(path);
        } else if frame.position().is_none() {
            tracing::warn!("{}: the truth has no position; skipped", frame.photo);
        } else {
            usable.push((frame, path));
        }
    }
    let mut without = picture_files(photos).unwrap_or_default();
    without.retain(|path| !listed.contains(&plain_path(path)));
    let not_there = "listed in the truth file but missing";
    warn_of(photos, &missing, not_there, not_there);
    warn_of(photos, &without, "has no truth", "without truth");
    if usable.is_empty() {
        return Err(DataSetError::NoTruth(photos.to_owned()));
    }
    Ok(usable)
}

/// Warns of photos of one fault, in words for one of them and for more.
fn warn_of(photos: &Path, found: &[PathBuf], fault: &str, fault_of_more: &str) {
    for path in found.iter().take(MOST_NAMED) {
        tracing::warn!("{}: {fault}; skipped", path.display());
    }
    if let Some(more @ 1..) = found.len().checked_sub(MOST_NAMED) {
        tracing::warn!("{}: {more} more {fault_of_more}; skipped", photos.display());
    }
}

/// A path without parts that lead nowhere, as in `photos/./a.jpg`.
fn plain_path(path: &Path) -> PathBuf {
    path.components().collect()
}

/// Whether two paths lead to one file.
fn is_same_file(a: &Path, b: &Path) -> bool {
    matches!((fs_err::canonicalize(a), fs_err::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners in a scene's table are those of its own map.
    #[test]
    fn another_map_keeps_its_own_place() {
        let root = tempfile::tempdir().unwrap();
        let scene = root.path().join("03");
        fs_err::create_dir_all(scene.join("drone")).unwrap();
        for (path, text) in [
            ("03/satellite03.tif", ""),
            ("03/drone/03_0001.JPG", ""),
            ("other.tif", ""),
            (
                "03/03.csv",
                "num,filename,date,lat,lon,height,Omega,Kappa,Phi1,Phi2\n\
                 1,03_0001.JPG,2018-10-21,32.30,119.90,466.3,0.1,0.2,-170.5,9.5\n",
            ),
            (
                "satellite_ coordinates_range.csv",
                "mapname,LT_lat_map,LT_lon_map,RB_lat_map,RB_lon_map,region\n\
                 satellite03.tif,32.355,119.805,32.251,119.955,Taizhou\n",
            ),
        ] {
            fs_err::write(root.path().join(path), text).unwrap();
        }
        let corners_with = |map: Option<&Path>| {
            let request = DataSetRequest {
                folder: &scene,
                map,
                map_options: MapOptions::default(),
                scratch: root.path(),
                photo_limits: PhotoLimits::DEFAULT,
            };
            DataSet::find(&request).unwrap().map_options.corners
        };
        let own = scene.join("drone/../satellite03.tif");
        assert!(corners_with(None).is_some());
        assert!(corners_with(Some(&own)).is_some());
        assert!(corners_with(Some(&root.path().join("other.tif"))).is_none());
    }

    fn request(folder: &Path) -> DataSetRequest<'_> {
        DataSetRequest {
            folder,
            map: None,
            map_options: MapOptions::default(),
            scratch: folder,
            photo_limits: PhotoLimits::DEFAULT,
        }
    }

    #[test]
    fn a_photo_is_scored_once_however_its_name_is_written() {
        let photos = tempfile::tempdir().unwrap();
        fs_err::write(photos.path().join("a.jpg"), "").unwrap();
        let frame = |photo: &str| TruthFrame {
            photo: photo.to_owned(),
            centre_lat_lon_deg: Some((1.0, 2.0)),
            ..TruthFrame::default()
        };
        let listed = vec![frame("./a.jpg"), frame("a.jpg")];
        let usable = scorable(listed, photos.path()).unwrap();
        assert_eq!(usable.len(), 1);
        assert_eq!(usable[0].0.photo, "./a.jpg");
    }

    #[test]
    fn a_data_set_says_how_many_of_its_truths_are_the_receivers() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("flight");
        fs_err::create_dir_all(folder.join(PHOTO_FOLDER)).unwrap();
        for photo in ["a.jpg", "b.jpg"] {
            fs_err::write(folder.join(PHOTO_FOLDER).join(photo), "").unwrap();
        }
        for (rows, name) in [
            ("a.jpg,1,2,1,2\nb.jpg,1,2,,\n", "flight"),
            (
                "a.jpg,1,2,1,2\nb.jpg,,,1,2\n",
                "flight (truth of 1 of 2 photos: receiver position)",
            ),
        ] {
            let table = format!("photo,lat_deg,lon_deg,gps_lat,gps_lon\n{rows}");
            fs_err::write(folder.join(TRUTH_FILE), table).unwrap();
            assert_eq!(DataSet::find(&request(&folder)).unwrap().name, name);
        }
    }

    #[test]
    fn the_map_among_the_photos_is_none_of_them() {
        let folder = tempfile::tempdir().unwrap();
        fs_err::write(folder.path().join(MAP_FILE), "").unwrap();
        let error = DataSet::find(&request(folder.path())).unwrap_err();
        assert!(matches!(error, DataSetError::NoPhotos { .. }), "{error}");
    }

    #[test]
    #[cfg(unix)]
    fn a_truth_file_that_cannot_be_read_is_no_reason_to_take_another_truth() {
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink("nowhere.csv", folder.path().join(TRUTH_FILE)).unwrap();
        let error = DataSet::find(&request(folder.path())).unwrap_err();
        assert!(error.to_string().contains(TRUTH_FILE), "{error}");
    }
}
