//! Localises photos on a map pack: the library's facade from end to end.
//!
//! ```text
//! cargo run --release -p grimnet-locate --example locate -- AREA.grim PHOTO...
//! ```

use std::error::Error;

use grimnet_locate::{Localizer, Outcome, Prior};
use grimnet_net::Model;
use grimnet_pack::Pack;
use grimnet_photo::Photo;

#[allow(clippy::print_stdout)]
fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [pack, photos @ ..] = &arguments[..] else {
        return Err("usage: locate AREA.grim PHOTO...".into());
    };
    let localizer = Localizer::new(Model::bundled()?, Pack::open(pack)?)?;
    for path in photos {
        let photo = Photo::open(path)?;
        match localizer.locate(&photo, &Prior::none())? {
            Outcome::Fix(fix) => {
                let (lat, lon, radius) = (fix.lat_deg, fix.lon_deg, fix.radius95_m);
                println!("{path}: {lat:.7} {lon:.7} ±{radius:.1} m");
            }
            Outcome::NoFix(reason) => println!("{path}: no fix: {reason}"),
        }
    }
    Ok(())
}
