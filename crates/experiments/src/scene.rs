//! What an experiment runs on: maps with photos whose place is known.

use std::path::{Path, PathBuf};

use grimnet_geo::{GeoError, LonLat, Raster};
use grimnet_locate::Prior;
use grimnet_photo::{Photo, PhotoError};

use grimnet_eval::truth::TruthFrame;

/// The true heading is given to the localiser with this uncertainty, degrees (1 sigma).
pub const HEADING_SIGMA_DEG: f64 = 5.0;

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
    /// A photo.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// A folder.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// The procedural world.
    #[error(transparent)]
    World(#[from] grimnet_world::WorldError),
}

impl Scene {
    /// A scene of a map and photos whose place is known; a photo whose place is not is left out.
    ///
    /// # Errors
    /// A photo cannot be read.
    pub fn of(
        name: &str,
        map: Box<dyn Raster>,
        frames: Vec<(TruthFrame, PathBuf)>,
        footprint_width_m: Option<f64>,
    ) -> Result<Self, SceneError> {
        let shots = frames
            .into_iter()
            .filter_map(|(frame, path)| shot(&path, frame, footprint_width_m).transpose())
            .collect::<Result<_, _>>()?;
        Ok(Self {
            name: name.to_owned(),
            map,
            shots,
        })
    }

    /// Ground width of the photos, metres: that of the middle one of those whose width is known.
    pub fn ground_width_m(&self) -> Option<f64> {
        let mut widths: Vec<f64> = self
            .shots
            .iter()
            .filter_map(|shot| {
                let view = shot.photo.view(&shot.prior(true).view);
                Some(view.footprint?.width_m)
            })
            .collect();
        widths.sort_by(f64::total_cmp);
        widths.get(widths.len() / 2).copied()
    }
}

fn shot(
    path: &Path,
    frame: TruthFrame,
    footprint_width_m: Option<f64>,
) -> Result<Option<Shot>, SceneError> {
    let Some((lat_deg, lon_deg)) = frame.centre_lat_lon_deg.or(frame.gps_lat_lon_deg) else {
        return Ok(None);
    };
    let photo = Photo::open(path)?;
    Ok(Some(Shot {
        gsd_m: footprint_width_m.map(|width_m| width_m / f64::from(photo.full_size_px.0)),
        name: frame.photo,
        photo,
        truth: LonLat { lon_deg, lat_deg },
        heading_deg: frame.heading_deg,
    }))
}
