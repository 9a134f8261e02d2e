//! Localises every photo of a folder and writes a CSV table to standard output.
//!
//! ```text
//! cargo run --release -p grimnet --example folder_to_csv -- AREA.grim FOLDER > fixes.csv
//! ```

use std::{error::Error, io::Write, path::PathBuf};

use grimnet::{Localizer, Outcome, Photo, Prior};

const EXTENSIONS: [&str; 6] = ["jpg", "jpeg", "png", "tif", "tiff", "webp"];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [pack, folder] = &arguments[..] else {
        return Err("usage: folder_to_csv AREA.grim FOLDER".into());
    };
    let localizer = Localizer::open(pack)?;
    let mut photos: Vec<PathBuf> = std::fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    photos.retain(|path| {
        let extension = path.extension().and_then(|extension| extension.to_str());
        extension.is_some_and(|found| EXTENSIONS.iter().any(|e| found.eq_ignore_ascii_case(e)))
    });
    photos.sort();

    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "photo,lat_deg,lon_deg,radius95_m,confidence,heading_deg,remark"
    )?;
    for path in &photos {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        // A photo that cannot be read has its line too and does not stop the others.
        let answer = Photo::open(path)
            .map_err(Box::<dyn Error>::from)
            .and_then(|photo| Ok(localizer.locate(&photo, &Prior::none())?));
        match answer {
            Ok(Outcome::Fix(fix)) => {
                let number = |value: Option<f64>, digits| {
                    value.map_or(String::new(), |value| format!("{value:.digits$}"))
                };
                let confidence = number(fix.confidence, 4);
                let heading = number(fix.heading_deg, 1);
                let (lat, lon, radius) = (fix.lat_deg, fix.lon_deg, fix.radius95_m);
                writeln!(
                    out,
                    "{},{lat:.8},{lon:.8},{radius:.3},{confidence},{heading},",
                    quoted(&name)
                )?;
            }
            Ok(Outcome::NoFix(reason)) => {
                let remark = quoted(&format!("no fix: {reason}"));
                writeln!(out, "{},,,,,,{remark}", quoted(&name))?;
            }
            Err(error) => {
                writeln!(out, "{},,,,,,{}", quoted(&name), quoted(&error.to_string()))?;
            }
        }
    }
    Ok(())
}

/// A CSV field in quotation marks (RFC 4180).
fn quoted(field: &str) -> String {
    format!("\"{}\"", field.replace('"', "\"\""))
}
