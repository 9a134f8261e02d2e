//! Times decoded photos to fixes, heading known and unknown.
//!
//! ```text
//! cargo run --release -p grimnet-locate --example time_locate -- AREA.grim PHOTO...
//! ```
//!
//! With `RAYON_NUM_THREADS=1` on one thread. Photos are decoded before the clock starts.

use std::error::Error;
use std::io::Write;
use std::time::Instant;

use grimnet_locate::{HeadingPrior, Localizer, Outcome, Prior, ViewPrior};
use grimnet_net::Model;
use grimnet_pack::Pack;
use grimnet_photo::Photo;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let pack = arguments
        .next()
        .ok_or("usage: time_locate AREA.grim PHOTO...")?;
    let localizer = Localizer::new(Model::bundled()?, Pack::open(pack)?)?;
    let decode = Instant::now();
    let photos = arguments
        .map(Photo::open)
        .collect::<Result<Vec<Photo>, _>>()?;
    let decode_ms = decode.elapsed().as_secs_f64() * 1e3 / photos.len().max(1) as f64;
    let mut out = std::io::stdout();
    writeln!(out, "decoding: mean {decode_ms:.1} ms a photo")?;
    for (name, heading) in [
        ("known", HeadingPrior::FromMetadata),
        ("unknown", HeadingPrior::Unknown),
    ] {
        let prior = Prior {
            view: ViewPrior {
                heading,
                ..ViewPrior::default()
            },
            near: None,
        };
        // The first photo warms up: it is measured again.
        if let Some(first) = photos.first() {
            localizer.locate(first, &prior)?;
        }
        let (mut times_ms, mut fixes) = (Vec::new(), 0);
        for photo in &photos {
            let start = Instant::now();
            let outcome = localizer.locate(photo, &prior)?;
            times_ms.push(start.elapsed().as_secs_f64() * 1e3);
            fixes += usize::from(matches!(outcome, Outcome::Fix(_)));
        }
        times_ms.sort_by(f64::total_cmp);
        let at = |share: f64| times_ms[((times_ms.len() - 1) as f64 * share).round() as usize];
        writeln!(
            out,
            "heading {name}: median {:.1} ms, 95 % {:.1} ms, {fixes} fixes of {}",
            at(0.5),
            at(0.95),
            photos.len()
        )?;
    }
    Ok(())
}
