//! Localises one photo on a pack.
//!
//! ```text
//! cargo run --release -p grimnet --example locate_photo -- AREA.grim PHOTO.jpg [HEADING_DEG]
//! ```

use std::{error::Error, io::Write};

use grimnet::{Localizer, Outcome, Photo, Prior};

/// 1-sigma of the heading that the user gives, degrees.
const HEADING_SIGMA_DEG: f64 = 5.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [pack, photo, heading @ ..] = &arguments[..] else {
        return Err("usage: locate_photo AREA.grim PHOTO.jpg [HEADING_DEG]".into());
    };
    let prior = match heading.first() {
        Some(degrees) => Prior::none().with_heading(degrees.parse()?, HEADING_SIGMA_DEG),
        None => Prior::none(),
    };
    let localizer = Localizer::open(pack)?;
    let outcome = localizer.locate(&Photo::open(photo)?, &prior)?;
    let mut out = std::io::stdout().lock();
    match outcome {
        Outcome::Fix(fix) => {
            let (lat, lon, radius) = (fix.lat_deg, fix.lon_deg, fix.radius95_m);
            writeln!(out, "{lat:.7} {lon:.7} ±{radius:.1} m")?;
            if let Some(heading_deg) = fix.heading_deg {
                writeln!(out, "heading {heading_deg:.1} degrees")?;
            }
            for evidence in &fix.evidence.set_aside {
                writeln!(out, "not used: {evidence}")?;
            }
        }
        Outcome::NoFix(reason) => writeln!(out, "no fix: {reason}")?,
    }
    Ok(())
}
