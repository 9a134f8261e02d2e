//! What an experiment runs on: maps with photos whose place is known.

use std::path::{Path, PathBuf};

use grimnet_geo::{GeoError, LonLat, MapOptions, Raster, open_map};
use grimnet_locate::Prior;
use grimnet_photo::{Photo, PhotoError};

use crate::truth::{self, TruthError, TruthFrame};

/// The true heading is given to the localiser with this uncertainty, degrees (1 sigma).
pub const HEADING_SIGMA_DEG: f64 = 5.0;

/// Longest side in pixels that a photo is decoded to; no query needs more.
const DECODED_SIDE_PX: u32 = 2048;

/// One photo and its truth.
#[derive(Debug)]
pub struct Shot {
    /// Its name.
    pub name: String,
    /// The photo.
    pub photo: Photo,
    /// Where its centre lies.
    pub truth: LonLat,
    /// Its true heading, degrees clockwise from north, where known.
    pub heading_deg: Option<f64>,
    /// Metres per pixel of the full-size photo, where known better than from its metadata.
    pub gsd_m: Option<f64>,
}

impl Shot {
    /// What the localiser is told: scale, and the heading where `with_heading`.
    pub fn prior(&self, with_heading: bool) -> Prior {
        let prior = match (with_heading, self.heading_deg) {
            (false, _) => Prior::none().with_unknown_heading(),
            (true, Some(heading_deg)) => Prior::none().with_heading(heading_deg, HEADING_SIGMA_DEG),
            (true, None) => Prior::none(),
        };
        match self.gsd_m {
            Some(gsd_m) => prior.with_gsd_m(gsd_m),
            None => prior,
        }
    }
}

/// A map and photos of it.
pub struct Scene {
    /// Its name, a column's head.
    pub name: String,
    /// The map.
    pub map: Box<dyn Raster>,
    /// The photos, in the order of flight.
    pub shots: Vec<Shot>,
}

/// A scene could not be made or read.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The map.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// The truth file.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// A photo.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// A folder.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The procedural world.
    #[error(transparent)]
    World(#[from] grimnet_world::WorldError),
    /// Nothing there.
    #[error("{0}: neither a data set (map.tif, photos/, truth.csv) nor a folder of such")]
    NoData(PathBuf),
}

impl Scene {
    /// Reads a folder with `map.tif`, `photos/` and `truth.csv`, or, as a scene each, all such folders in it, by name. Photos that are
    /// not there or whose place is not known are left out.
    ///
    /// # Errors
    /// No such folder; an unreadable map, truth file or photo.
    pub fn read_all(
        folder: &Path,
        footprint_width_m: Option<f64>,
    ) -> Result<Vec<Self>, SceneError> {
        if is_data_set(folder) {
            return Ok(vec![Self::read(folder, footprint_width_m)?]);
        }
        let mut folders: Vec<PathBuf> = fs_err::read_dir(folder)?
            .filter_map(|entry| entry.ok().map(|e| e.path()))
            .filter(|path| is_data_set(path))
            .collect();
        folders.sort();
        if folders.is_empty() {
            return Err(SceneError::NoData(folder.to_owned()));
        }
        folders
            .iter()
            .map(|f| Self::read(f, footprint_width_m))
            .collect()
    }

    /// Ground width of the photos, metres: that of the middle one of those whose width is known.
    pub fn ground_width_m(&self) -> Option<f64> {
        let mut widths: Vec<f64> = self
            .shots
            .iter()
            .filter_map(|shot| {
                let view = shot.photo.view(&shot.prior(true).overrides());
                Some(view.footprint?.width_m)
            })
            .collect();
        widths.sort_by(f64::total_cmp);
        widths.get(widths.len() / 2).copied()
    }

    fn read(folder: &Path, footprint_width_m: Option<f64>) -> Result<Self, SceneError> {
        let map = open_map(&folder.join("map.tif"), &MapOptions::default())?;
        let mut shots = Vec::new();
        for frame in truth::read(&folder.join("truth.csv"))? {
            let path = folder.join("photos").join(&frame.photo);
            if path.is_file() {
                shots.extend(shot(&path, frame, footprint_width_m)?);
            } else {
                tracing::warn!(
                    "{}: named in truth.csv and not there; left out",
                    path.display()
                );
            }
        }
        let name = folder.file_name().map(|n| n.to_string_lossy().into_owned());
        Ok(Self {
            name: name.unwrap_or_else(|| "data".to_owned()),
            map,
            shots,
        })
    }
}

fn is_data_set(folder: &Path) -> bool {
    folder.join("map.tif").is_file() && folder.join("truth.csv").is_file()
}

fn shot(
    path: &Path,
    frame: TruthFrame,
    footprint_width_m: Option<f64>,
) -> Result<Option<Shot>, SceneError> {
    let Some((lat_deg, lon_deg)) = frame.centre_lat_lon_deg.or(frame.gps_lat_lon_deg) else {
        return Ok(None);
    };
    let photo = Photo::open_reduced(path, DECODED_SIDE_PX)?;
    Ok(Some(Shot {
        gsd_m: footprint_width_m.map(|width_m| width_m / f64::from(photo.full_size_px.0)),
        name: frame.photo,
        photo,
        truth: LonLat { lon_deg, lat_deg },
        heading_deg: frame.heading_deg,
    }))
}
