//! Scenes of the procedural world: a flight over it, with one condition changed at a time.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use grimnet_geo::{GeoError, LonLat, MapOptions, open_map};
use grimnet_locate::Prior;
use grimnet_photo::{Metadata, Photo};
use grimnet_world::{
    Camera, Flight, Look, Placement, Pose, RegionM, Season, TruthRow, World, WorldConfig,
    WorldError, write_geotiff,
};

use grimnet_eval::scene::{PhotoSource, Scene, Shot, TRUE_HEADING_SIGMA_DEG, Truth};

/// Position of procedural worlds: in the Gulf of Guinea, where there is no land.
const PLACE_LON_LAT_DEG: [f64; 2] = [1.5, 1.0];

/// Ground resolution of the maps, metres per pixel: that of a good aerial orthophoto.
pub const MAP_GSD_M: f64 = 0.3;

/// The camera: similar to that of a small consumer drone, at a resolution that keeps experiments short.
const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 800,
    height_px: 600,
};

/// Why a flight cannot be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FlightError {
    /// The world or its map.
    #[error(transparent)]
    World(#[from] WorldError),
    /// The written map cannot be read.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// The folder cannot be created.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// A flight over a procedural world.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldFlight {
    /// The scene's name.
    pub name: String,
    /// Seed of world and flight.
    pub seed: u64,
    /// Side of the square map, metres.
    pub size_m: f64,
    /// Share of it that is town.
    pub urban: f32,
    /// Photos.
    pub photos: usize,
    /// Appearance of the map.
    pub map_look: Look,
    /// Appearance of the photos.
    pub photo_look: Look,
    /// Change of each pose.
    pub change: PoseChange,
    /// Whether the photos show another world than the map, so that none may get a fix.
    pub wrong_area: bool,
}

/// A change of every pose of a flight.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum PoseChange {
    /// None: lines with turns between them, 100 to 130 m above ground, tilts of about 2 degrees.
    #[default]
    None,
    /// All photos point this way, degrees clockwise from north.
    Heading(f64),
    /// Heights times this, also in the metadata.
    Height(f64),
    /// Heights times this; the metadata keep the original heights.
    UnreportedHeight(f64),
    /// Camera pitch ahead of straight down, degrees, also in the metadata.
    Pitch(f64),
}

impl WorldFlight {
    /// The flight of the experiments over one world: summer map, autumn photos.
    pub fn over(name: &str, seed: u64, size_m: f64, urban: f32, photos: usize) -> Self {
        Self {
            name: name.to_owned(),
            seed,
            size_m,
            urban,
            photos,
            map_look: Look::satellite(Season::Summer),
            photo_look: Look::drone(Season::Autumn),
            change: PoseChange::None,
            wrong_area: false,
        }
    }

    /// Draws map and photos; the map is written into `folder`.
    ///
    /// # Errors
    /// The map cannot be written.
    pub fn make(&self, folder: &Path) -> Result<Scene, FlightError> {
        self.over_map(&self.draw_map(folder)?)
    }

    /// Draws the map into `folder`; returns its path.
    ///
    /// # Errors
    /// The map cannot be written.
    pub fn draw_map(&self, folder: &Path) -> Result<PathBuf, FlightError> {
        fs_err::create_dir_all(folder)?;
        let world = self.world(self.seed);
        let placement = placement()?;
        let whole = RegionM {
            x_min_m: 0.0,
            y_min_m: 0.0,
            width_m: world.size_m(),
            height_m: world.size_m(),
        };
        let picture = world.render_map(whole, MAP_GSD_M, &self.map_look);
        let path = folder.join(format!("{}.tif", self.name.replace(' ', "_")));
        let north_west_m = placement.utm_from_world([0.0, world.size_m()]);
        write_geotiff(&path, &picture, MAP_GSD_M, north_west_m, placement.epsg())?;
        Ok(path)
    }

    /// Draws the photos, over the map that [`draw_map`](Self::draw_map) drew for a flight with the same map.
    ///
    /// # Errors
    /// The map cannot be read.
    pub fn over_map(&self, map: &Path) -> Result<Scene, FlightError> {
        let flown = if self.wrong_area {
            self.world(self.seed ^ WRONG_AREA)
        } else {
            self.world(self.seed)
        };
        let placement = placement()?;
        let flight = Flight::plan(&flown, self.photos, self.seed);
        let shots = flight
            .frames
            .iter()
            .enumerate()
            .map(|(i, frame)| self.shot(&flown, &placement, i, frame.pose, frame.reported))
            .collect::<Result<_, FlightError>>()?;
        Ok(Scene {
            name: self.name.clone(),
            map: open_map(map, &MapOptions::default())?,
            shots,
        })
    }

    fn world(&self, seed: u64) -> World {
        World::new(WorldConfig {
            seed,
            size_m: self.size_m,
            urban: self.urban,
            ..WorldConfig::default()
        })
    }

    fn shot(
        &self,
        world: &World,
        placement: &Placement,
        index: usize,
        pose: Pose,
        reported: Pose,
    ) -> Result<Shot, FlightError> {
        let (pose, reported) = self.change.of(pose, reported);
        let name = format!("{:03}", index + 1);
        let picture = world.render_photo(&pose, &CAMERA, &self.photo_look);
        let truth = TruthRow::new(&name, &pose, &CAMERA, placement)?;
        let reported_deg = truth.heading_deg + reported.heading_deg - pose.heading_deg;
        let metadata = Metadata {
            gimbal_yaw_deg: Some(reported_deg.rem_euclid(360.0)),
            gimbal_pitch_deg: Some(reported.pitch_off_nadir_deg - 90.0),
            gimbal_roll_deg: Some(reported.roll_deg),
            relative_altitude_m: Some(reported.height_agl_m),
            calibrated_focal_px: Some(CAMERA.focal_px()),
            orientation: 1,
            ..Metadata::default()
        };
        let position = LonLat {
            lon_deg: truth.lon_deg,
            lat_deg: truth.lat_deg,
        };
        Ok(Shot {
            name,
            photo: PhotoSource::Memory(Arc::new(Photo::from_image(picture, metadata))),
            truth: Truth::at(position),
            known: Prior::none()
                .with_heading(reported_deg.rem_euclid(360.0), TRUE_HEADING_SIGMA_DEG),
            footprint_width_m: None,
        })
    }
}

/// Where the worlds lie.
fn placement() -> Result<Placement, WorldError> {
    let [lon_deg, lat_deg] = PLACE_LON_LAT_DEG;
    Placement::at(lon_deg, lat_deg)
}

/// Turns a world's seed into that of another world.
const WRONG_AREA: u64 = 0x5eed_0fff;

impl PoseChange {
    /// True and reported pose after the change.
    fn of(self, mut pose: Pose, mut reported: Pose) -> (Pose, Pose) {
        let error_deg = reported.heading_deg - pose.heading_deg;
        match self {
            Self::None => {}
            Self::Heading(deg) => (pose.heading_deg, reported.heading_deg) = (deg, deg + error_deg),
            Self::Height(factor) => {
                pose.height_agl_m *= factor;
                reported.height_agl_m *= factor;
            }
            Self::UnreportedHeight(factor) => pose.height_agl_m *= factor,
            Self::Pitch(deg) => {
                pose.pitch_off_nadir_deg += deg;
                reported.pitch_off_nadir_deg += deg;
            }
        }
        (pose, reported)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_geo::distance_m;

    fn picture(shot: &Shot) -> image::RgbImage {
        shot.photo.open().unwrap().image.clone()
    }

    #[test]
    fn one_thing_changes_at_a_time() {
        let pose = Pose::default();
        let (flown, said) = PoseChange::Heading(90.0).of(pose, pose);
        assert_eq!((flown.heading_deg, said.heading_deg), (90.0, 90.0));
        let (flown, said) = PoseChange::UnreportedHeight(2.0).of(pose, pose);
        assert_eq!((flown.height_agl_m, said.height_agl_m), (240.0, 120.0));
    }

    #[test]
    fn a_flight_has_a_map_and_photos_on_it() {
        let folder = tempfile::tempdir().unwrap();
        let flight = WorldFlight::over("hamlet", 3, 300.0, 0.5, 2);
        let scene = flight.make(folder.path()).unwrap();
        assert_eq!((scene.shots.len(), scene.map.size_px()), (2, (1000, 1000)));
        let [first, second] = &scene.shots[..] else {
            panic!("two shots");
        };
        assert!(distance_m(first.truth.position, second.truth.position) > 1.0);
        let at = scene
            .map
            .georeference()
            .map_px_from_lonlat(first.truth.position)
            .unwrap();
        assert!((100.0..900.0).contains(&at.x) && (100.0..900.0).contains(&at.y));
        // The same flight is the same; that of another world is not.
        let again = flight.make(folder.path()).unwrap();
        assert_eq!(picture(&again.shots[0]), picture(first));
        let elsewhere = WorldFlight {
            wrong_area: true,
            ..flight
        };
        assert_ne!(
            picture(&elsewhere.make(folder.path()).unwrap().shots[0]),
            picture(first)
        );
    }
}
