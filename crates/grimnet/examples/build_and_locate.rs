//! Builds a pack from a map if it is not there yet, then localises a photo within 2 km of a known position.
//!
//! ```text
//! cargo run --release -p grimnet --example build_and_locate -- MAP.tif AREA.grim PHOTO.jpg LAT LON
//! ```

use std::{error::Error, io::Write};

use grimnet::{
    Localizer, LonLat, Options, Outcome, Photo, Prior,
    map::{self, MapBuild},
};

const RADIUS_M: f64 = 2000.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [map, pack, photo, lat_deg, lon_deg] = &arguments[..] else {
        return Err("usage: build_and_locate MAP.tif AREA.grim PHOTO.jpg LAT LON".into());
    };
    let mut out = std::io::stdout().lock();
    let mut percent = 0;
    let report = map::build(map, pack, &MapBuild::default(), |progress| {
        let done = 100 * progress.tiles_done / progress.tiles_total.max(1);
        if done >= percent + 10 {
            percent = done;
            // A closed terminal must not stop the build.
            let _ = writeln!(out, "{done} % of the tiles");
        }
    })?;
    writeln!(out, "{}: {} tiles", report.path.display(), report.tiles)?;

    let localizer = Localizer::builder()
        .options(Options {
            // The map is known to be registered to half a metre.
            map_error_m: 0.5,
            ..Options::default()
        })
        .open(pack)?;
    let position = LonLat::new(lon_deg.parse()?, lat_deg.parse()?);
    let prior = Prior::none().near(position, RADIUS_M);
    match localizer.locate(&Photo::open(photo)?, &prior)? {
        Outcome::Fix(fix) => {
            let (lat, lon, radius) = (fix.lat_deg, fix.lon_deg, fix.radius95_m);
            writeln!(out, "{lat:.7} {lon:.7} ±{radius:.1} m")?;
        }
        Outcome::NoFix(reason) => writeln!(out, "no fix: {reason}")?,
    }
    Ok(())
}
