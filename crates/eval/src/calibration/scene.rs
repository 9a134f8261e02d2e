//! Maps with photos whose truth is exact: procedural worlds, and pictures that photos are cut from.

use std::path::{Path, PathBuf};

use grimnet_geo::LonLat;
use grimnet_locate::Prior;
use grimnet_photo::{Metadata, Photo};
use grimnet_world::{
    Camera, Look, Placement, Pose, RegionM, TruthRow, World, WorldConfig, WorldError, write_geotiff,
};
use image::RgbImage;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::cut::{Cut, Mosaic};

/// A photo, where its centre lies, and what its drone would know of it.
#[derive(Debug)]
pub struct Shot {
    /// The photo, with metadata that err as a drone's do.
    pub photo: Photo,
    /// Its centre on the ground.
    pub truth: LonLat,
    /// What is known beside the metadata.
    pub prior: Prior,
}

/// A map and photos of it.
#[derive(Debug)]
pub struct Scene {
    /// What it shows, for people.
    pub name: String,
    /// The map, a GeoTIFF.
    pub map: PathBuf,
    /// Its photos.
    pub shots: Vec<Shot>,
}

/// Why a scene cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The world or its map cannot be drawn or written.
    #[error(transparent)]
    World(#[from] WorldError),
    /// A picture cannot be read.
    #[error("{path}: {source}")]
    Picture {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        source: image::ImageError,
    },
    /// A folder cannot be read.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A folder has no pictures.
    #[error("{path}: no picture of at least {min_px} x {min_px} pixels in it")]
    NoPictures {
        /// The folder.
        path: PathBuf,
        /// Least side.
        min_px: u32,
    },
}

/// Where made-up places lie: in the Gulf of Guinea, where there is no land.
const PLACE_LON_LAT_DEG: [f64; 2] = [1.5, 1.0];
/// Side of a world, metres.
const WORLD_M: f64 = 640.0;
/// Width of a photo, pixels: half as much again as a query has.
const PHOTO_PX: (u32, u32) = (640, 480);
/// Errors of a drone's metadata, 1-sigma: compass, barometer and ground, gimbal.
const HEADING_SIGMA_DEG: f64 = 3.0;
const HEIGHT_SIGMA: f64 = 0.05;
const GIMBAL_SIGMA_DEG: f64 = 0.7;

/// A normal deviate (Box & Muller 1958).
pub(crate) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * rng.random_range(f64::MIN_POSITIVE..1.0).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

/// A world of its own seed, drawn once as a satellite sees it and `photos` times as a drone does: any heading, 60 to 150 m
/// above ground, up to 20 degrees off nadir, each in another season, light and camera.
///
/// # Errors
/// The map cannot be written into `folder`.
pub fn world(seed: u64, photos: usize, folder: &Path) -> Result<Scene, SceneError> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let world = World::new(WorldConfig {
        seed,
        size_m: WORLD_M,
        urban: rng.random_range(0.15..0.95),
        bend: rng.random_range(0.1..0.9),
    });
    let [lon_deg, lat_deg] = PLACE_LON_LAT_DEG;
    let placement = Placement::at(lon_deg, lat_deg)?;
    let gsd_m = rng.random_range(0.2..0.4);
    let whole = RegionM {
        x_min_m: 0.0,
        y_min_m: 0.0,
        width_m: WORLD_M,
        height_m: WORLD_M,
    };
    let picture = world.render_map(whole, gsd_m, &Look::varied_satellite(seed));
    let map = folder.join(format!("world_{seed}.tif"));
    let north_west_m = placement.utm_from_world([0.0, WORLD_M]);
    write_geotiff(&map, &picture, gsd_m, north_west_m, placement.epsg())?;
    let shots = (0..photos)
        .map(|_| world_shot(&world, &placement, &mut rng))
        .collect::<Result<_, _>>()?;
    Ok(Scene {
        name: format!("procedural world {seed}"),
        map,
        shots,
    })
}

fn world_shot(
    world: &World,
    placement: &Placement,
    rng: &mut ChaCha8Rng,
) -> Result<Shot, SceneError> {
    let camera = Camera {
        hfov_deg: rng.random_range(60.0..84.0),
        width_px: PHOTO_PX.0,
        height_px: PHOTO_PX.1,
    };
    // Either the gimbal tells its pitch, or it is said to look straight down and nearly does.
    let pitch_told = rng.random_bool(0.5);
    let pitch_sigma_deg = if pitch_told { 8.0 } else { 2.5 };
    let inside = 0.2 * WORLD_M..0.8 * WORLD_M;
    let pose = Pose {
        x_m: rng.random_range(inside.clone()),
        y_m: rng.random_range(inside),
        height_agl_m: rng.random_range(60f64.ln()..150f64.ln()).exp(),
        heading_deg: rng.random_range(0.0..360.0),
        pitch_off_nadir_deg: (pitch_sigma_deg * normal(rng)).clamp(-20.0, 20.0),
        roll_deg: 1.5 * normal(rng),
    };
    let photo = world.render_photo(&pose, &camera, &Look::varied_drone(rng.random()));
    let row = TruthRow::new("", &pose, &camera, placement)?;
    let told_deg = (row.heading_deg + HEADING_SIGMA_DEG * normal(rng)).rem_euclid(360.0);
    let metadata = Metadata {
        gimbal_yaw_deg: Some(told_deg),
        gimbal_pitch_deg: Some(if pitch_told {
            pose.pitch_off_nadir_deg - 90.0 + GIMBAL_SIGMA_DEG * normal(rng)
        } else {
            -90.0
        }),
        gimbal_roll_deg: Some(0.0),
        relative_altitude_m: Some(pose.height_agl_m * (1.0 + HEIGHT_SIGMA * normal(rng))),
        calibrated_focal_px: Some(camera.focal_px()),
        orientation: 1,
        ..Metadata::default()
    };
    Ok(Shot {
        photo: Photo::from_image(photo, metadata),
        truth: LonLat {
            lon_deg: row.lon_deg,
            lat_deg: row.lat_deg,
        },
        prior: Prior::none().with_heading(told_deg, HEADING_SIGMA_DEG),
    })
}

/// Pictures of a folder put side by side as one map, and `photos` photos cut from them under a homography and in another
/// light. Their ground resolution is taken to be `gsd_m` metres a pixel: only the unit of length depends on it.
///
/// # Errors
/// The folder has no pictures, one cannot be decoded, or the map cannot be written into `folder_out`.
pub fn pictures(
    folder: &Path,
    gsd_m: f64,
    photos: usize,
    seed: u64,
    folder_out: &Path,
) -> Result<Scene, SceneError> {
    let mosaic = Mosaic::of_folder(folder)?;
    let name = folder
        .file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .unwrap_or_default();
    let [lon_deg, lat_deg] = PLACE_LON_LAT_DEG;
    let placement = Placement::at(lon_deg, lat_deg)?;
    let map = folder_out.join(format!("pictures_{seed}.tif"));
    let height_m = f64::from(mosaic.picture.height()) * gsd_m;
    let north_west_m = placement.utm_from_world([0.0, height_m]);
    write_geotiff(&map, &mosaic.picture, gsd_m, north_west_m, placement.epsg())?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let shots = (0..photos)
        .map(|_| {
            let cut = Cut::random(&mosaic, PHOTO_PX, &mut rng);
            let photo: RgbImage = cut.photo(&mosaic, PHOTO_PX, &mut rng);
            let [x_px, y_px] = cut.centre_map_px;
            let at = [x_px * gsd_m, height_m - y_px * gsd_m];
            let [lon_deg, lat_deg] = placement.lonlat_from_world(at)?;
            let heading_deg = cut.heading_deg + placement.grid_north_deg(at)?;
            let told_deg = (heading_deg + HEADING_SIGMA_DEG * normal(&mut rng)).rem_euclid(360.0);
            let scale = 1.0 + HEIGHT_SIGMA * normal(&mut rng);
            let metadata = Metadata {
                orientation: 1,
                ..Metadata::default()
            };
            Ok(Shot {
                photo: Photo::from_image(photo, metadata),
                truth: LonLat { lon_deg, lat_deg },
                prior: Prior::none()
                    .with_heading(told_deg, HEADING_SIGMA_DEG)
                    .with_gsd_m(cut.map_px_per_photo_px * gsd_m * scale),
            })
        })
        .collect::<Result<_, SceneError>>()?;
    Ok(Scene {
        name: format!("pictures of {name}"),
        map,
        shots,
    })
}
