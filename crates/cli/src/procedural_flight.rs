//! A flight over a procedural town: map, photos with metadata, and true positions.

use std::path::Path;

use anyhow::Result;
use grimnet_eval::tracks::town::Town;
use grimnet_output::OutputFolder;
use grimnet_world::{
    Camera, Crossing, Flight, Look, PhotoTags, Placement, RegionM, Season, TruthRow, World,
    WorldConfig, write_geotiff, write_jpeg_with_exif, write_truth_csv,
};
use image::RgbImage;

use crate::progress;

/// Name of the map in its folder.
pub const MAP: &str = "map.tif";

/// Ground resolution of the map, metres per pixel: that of a good aerial orthophoto.
pub const MAP_GSD_M: f64 = 0.3;

/// The camera: similar to that of a small consumer drone, at a resolution that keeps the demo short.
const CAMERA: Camera = Camera {
    hfov_deg: 70.0,
    width_px: 1200,
    height_px: 900,
};

/// Where the town is placed: in the Gulf of Guinea, where there is none.
const PLACE_LON_LAT_DEG: [f64; 2] = [1.5, 1.0];

/// Ground above the sea, metres, as the photos' GPS altitude has it.
const GROUND_ALTITUDE_M: f64 = 40.0;

/// Quality of the photos' JPEG.
const JPEG_QUALITY: u8 = 90;

/// Renders the map and the photos with their metadata, and writes the true positions: `map.tif`, `photos/`, `truth.csv`.
///
/// # Errors
/// The folder cannot be written, or holds files of these names that the program did not write.
pub fn make_flight(out: &OutputFolder, seed: u64, count: usize) -> Result<()> {
    let photos = out.subfolder("photos")?;
    let names: Vec<String> = (1..=count)
        .map(|number| format!("flight_{number:03}.jpg"))
        .collect();
    out.check([MAP, "truth.csv"])?;
    photos.check(&names)?;
    let town = make_town(seed)?;
    draw_map(out, &town)?;
    // The renderer writes to paths.
    let scratch = tempfile::tempdir()?;
    let scratch = scratch.path();
    let Town { world, placement } = &town;
    let flight = Flight::plan(world, count, seed);
    let bar = progress::bar(
        flight.frames.len() as u64,
        "flying over the town",
        "pictures",
    );
    let look = Look::drone(Season::Autumn);
    let mut rows = Vec::with_capacity(flight.frames.len());
    for (frame, name) in flight.frames.iter().zip(&names) {
        let photo: RgbImage = world.render_photo(&frame.pose, &CAMERA, &look);
        let tags = PhotoTags::for_pose(&frame.reported, &CAMERA, placement, GROUND_ALTITUDE_M)?;
        write_jpeg_with_exif(&scratch.join(name), &photo, JPEG_QUALITY, &tags)?;
        move_into(&photos, name, scratch)?;
        rows.push(TruthRow::new(name, &frame.pose, &CAMERA, placement)?);
        bar.inc(1);
    }
    write_truth_csv(&scratch.join("truth.csv"), &rows)?;
    move_into(out, "truth.csv", scratch)?;
    // Photos of an earlier, longer flight have no truth any more.
    photos.prune(|_| true)?;
    bar.finish_and_clear();
    Ok(())
}

/// Makes the town of a seed.
///
/// # Errors
/// The place is outside of the projection.
pub fn make_town(seed: u64) -> Result<Town> {
    let world = World::new(WorldConfig {
        seed,
        ..WorldConfig::default()
    });
    let [lon_deg, lat_deg] = PLACE_LON_LAT_DEG;
    let placement = Placement::at(lon_deg, lat_deg)?;
    Ok(Town { world, placement })
}

/// Renders the map of a town, `map.tif`.
///
/// # Errors
/// As [`make_flight`].
pub fn draw_map(out: &OutputFolder, town: &Town) -> Result<()> {
    out.check([MAP])?;
    let scratch = tempfile::tempdir()?;
    let Town { world, placement } = town;
    let size_m = world.size_m();
    let bar = progress::bar(1, "drawing the town", "maps");
    let whole = RegionM {
        x_min_m: 0.0,
        y_min_m: 0.0,
        width_m: size_m,
        height_m: size_m,
    };
    let map = world.render_map(whole, MAP_GSD_M, &Look::satellite(Season::Summer));
    let north_west_m = placement.utm_from_world([0.0, size_m]);
    write_geotiff(
        &scratch.path().join(MAP),
        &map,
        MAP_GSD_M,
        north_west_m,
        placement.epsg(),
    )?;
    move_into(out, MAP, scratch.path())?;
    bar.finish_and_clear();
    Ok(())
}

/// Frames of the flight that is followed, and metres between them: half a kilometre.
const CROSSING_FRAMES: usize = 36;
const CROSSING_SPACING_M: f64 = 14.0;

/// The camera of the flight that is followed.
const CROSSING_CAMERA: Camera = Camera {
    width_px: 800,
    height_px: 600,
    ..CAMERA
};

/// Renders a flight over the town of [`make_flight`], a frame a second: `flight/` with the photos, and their true positions in
/// `flight_truth.csv`. Gives the shares of town, countryside and water below it.
///
/// # Errors
/// As [`make_flight`].
pub fn make_crossing(out: &OutputFolder, seed: u64) -> Result<[f64; 3]> {
    let photos = out.subfolder("flight")?;
    let names: Vec<String> = (1..=CROSSING_FRAMES)
        .map(|number| format!("frame_{number:03}.jpg"))
        .collect();
    out.check(["flight_truth.csv"])?;
    photos.check(&names)?;
    let scratch = tempfile::tempdir()?;
    let scratch = scratch.path();
    let Town { world, placement } = make_town(seed)?;
    let crossing = Crossing::plan(&world, CROSSING_FRAMES, CROSSING_SPACING_M, seed);
    let look = Look::drone(Season::Autumn);
    let bar = progress::bar(CROSSING_FRAMES as u64, "drawing the flight", "frames");
    let mut truth = String::from("photo,gps_lat,gps_lon,height_agl_m\n");
    for (number, (frame, name)) in crossing.frames.iter().zip(&names).enumerate() {
        let photo: RgbImage = world.render_photo(&frame.pose, &CROSSING_CAMERA, &look);
        let tags = PhotoTags {
            taken: format!("2026:06:21 10:{:02}:{:02}.00", number / 60, number % 60),
            ..PhotoTags::for_pose(
                &frame.reported,
                &CROSSING_CAMERA,
                &placement,
                GROUND_ALTITUDE_M,
            )?
        };
        write_jpeg_with_exif(&scratch.join(name), &photo, JPEG_QUALITY, &tags)?;
        move_into(&photos, name, scratch)?;
        let [lon_deg, lat_deg] = placement.lonlat_from_world([frame.pose.x_m, frame.pose.y_m])?;
        truth += &format!(
            "{name},{lat_deg:.9},{lon_deg:.9},{:.3}\n",
            frame.pose.height_agl_m
        );
        bar.inc(1);
    }
    out.write_bytes("flight_truth.csv", truth.as_bytes())?;
    photos.prune(|_| true)?;
    bar.finish_and_clear();
    Ok(crossing.shares)
}

/// Moves a file from a scratch folder to where it belongs.
///
/// # Errors
/// It cannot be read or written.
fn move_into(folder: &OutputFolder, name: &str, scratch: &Path) -> Result<()> {
    let written = scratch.join(name);
    let mut file = fs_err::File::open(&written)?;
    folder.write(name, |out| std::io::copy(&mut file, out).map(drop))?;
    fs_err::remove_file(&written)?;
    Ok(())
}
