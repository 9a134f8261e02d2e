//! Scenes with exact truth: procedural worlds, and pictures that photos are cut from.

use std::path::Path;
use std::sync::Arc;

use grimnet_geo::{GeoError, LonLat, MapOptions, open_map};
use grimnet_locate::Prior;
use grimnet_photo::{Metadata, Photo};
use grimnet_world::{
    Camera, Look, Placement, Pose, RegionM, TruthRow, World, WorldConfig, WorldError, write_geotiff,
};
use image::RgbImage;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::cut::Cut;
pub use super::cut::{Mosaic, MosaicError};
use super::normal::normal;
use crate::scene::{PhotoSource, Scene, Shot, Truth};
use grimnet_photo::pictures::file_name;

/// Why a scene cannot be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The world or its map cannot be drawn or written.
    #[error(transparent)]
    World(#[from] WorldError),
    /// The pictures of a folder cannot be used.
    #[error(transparent)]
    Mosaic(#[from] MosaicError),
    /// The written map cannot be read.
    #[error(transparent)]
    Map(#[from] GeoError),
}

/// Position of procedural worlds: in the Gulf of Guinea, where there is no land.
const PLACE_LON_LAT_DEG: [f64; 2] = [1.5, 1.0];
/// Side of a world, metres.
const WORLD_M: f64 = 640.0;
/// Size of a photo, pixels: one and a half times the width of a query.
const PHOTO_PX: (u32, u32) = (640, 480);
/// Errors of a drone's metadata (1 sigma): compass, height above ground, gimbal.
const HEADING_SIGMA_DEG: f64 = 3.0;
const HEIGHT_SIGMA: f64 = 0.05;
const GIMBAL_SIGMA_DEG: f64 = 0.7;

/// A procedural world rendered once as a satellite sees it and `photos` times as a drone does: any heading, 60 to 150 m above
/// ground, up to 20 degrees off nadir, each with another season, light and camera.
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
        map: open_map(&map, &MapOptions::default())?,
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
    // Either the gimbal reports its pitch, or it reports straight down and nearly looks there.
    let pitch_reported = rng.random_bool(0.5);
    let pitch_sigma_deg = if pitch_reported { 8.0 } else { 2.5 };
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
    let stated_deg = (row.heading_deg + HEADING_SIGMA_DEG * normal(rng)).rem_euclid(360.0);
    let metadata = Metadata {
        gimbal_yaw_deg: Some(stated_deg),
        gimbal_pitch_deg: Some(if pitch_reported {
            pose.pitch_off_nadir_deg - 90.0 + GIMBAL_SIGMA_DEG * normal(rng)
        } else {
            -90.0
        }),
        gimbal_roll_deg: Some(0.0),
        calibrated_focal_px: Some(camera.focal_px()),
        orientation: 1,
        ..Metadata::default()
    };
    let position = LonLat {
        lon_deg: row.lon_deg,
        lat_deg: row.lat_deg,
    };
    // Given, as the ground resolution of photos cut from pictures is: the confidence of an answer is that with the width given.
    let known = Prior::none()
        .with_heading(stated_deg, HEADING_SIGMA_DEG)
        .with_height_agl_m(pose.height_agl_m * (1.0 + HEIGHT_SIGMA * normal(rng)));
    Ok(shot(photo, metadata, position, known))
}

/// The pictures of a folder side by side as one map, and `photos` photos cut from them under a homography and a change of light.
/// Their ground resolution is assumed to be `gsd_m` metres per pixel: the unit of length depends on it, and with that which answers are
/// right.
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
    let name = file_name(folder);
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
            let stated_deg = (heading_deg + HEADING_SIGMA_DEG * normal(&mut rng)).rem_euclid(360.0);
            let scale = 1.0 + HEIGHT_SIGMA * normal(&mut rng);
            let metadata = Metadata {
                orientation: 1,
                ..Metadata::default()
            };
            let known = Prior::none()
                .with_heading(stated_deg, HEADING_SIGMA_DEG)
                .with_gsd_m(cut.map_px_per_photo_px * gsd_m * scale);
            Ok(shot(photo, metadata, LonLat { lon_deg, lat_deg }, known))
        })
        .collect::<Result<_, SceneError>>()?;
    Ok(Scene {
        name: format!("pictures of {name}"),
        map: open_map(&map, &MapOptions::default())?,
        shots,
    })
}

fn shot(photo: RgbImage, metadata: Metadata, position: LonLat, known: Prior) -> Shot {
    Shot {
        name: String::new(),
        photo: PhotoSource::Memory(Arc::new(Photo::from_image(photo, metadata))),
        truth: Truth::at(position),
        known,
        footprint_width_m: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ground_width_of_photos_of_worlds_is_given() {
        let world = World::new(WorldConfig {
            seed: 5,
            size_m: WORLD_M,
            urban: 0.5,
            bend: 0.5,
        });
        let [lon_deg, lat_deg] = PLACE_LON_LAT_DEG;
        let placement = Placement::at(lon_deg, lat_deg).unwrap();
        let shot = world_shot(&world, &placement, &mut ChaCha8Rng::seed_from_u64(5)).unwrap();
        let photo = shot.photo.open().unwrap();
        let footprint = photo.view(&shot.known.view).footprint.unwrap();
        assert!(!footprint.is_uncertain(), "{footprint:?}");
    }
}
