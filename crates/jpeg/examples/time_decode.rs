//! Times decoding of a JPEG at full and at reduced size on this machine, the sizes by turns.
//!
//! ```text
//! cargo run --release -p grimnet-jpeg --example time_decode -- PHOTO.jpg [THREADS [DIVISOR]]
//! ```
//!
//! With a divisor (1, 2, 4 or 8) only that size is decoded, so that the processor time of two runs can be compared.

use std::error::Error;
use std::io::Write;
use std::time::Instant;

use grimnet_jpeg::{Jpeg, Reduction};

/// Decodings at each size.
const TURNS: usize = 21;
const SIZES: [Option<Reduction>; 4] = [
    None,
    Some(Reduction::Half),
    Some(Reduction::Quarter),
    Some(Reduction::Eighth),
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, numbers @ ..] = &arguments[..] else {
        return Err("usage: time_decode PHOTO.jpg [THREADS [DIVISOR]]".into());
    };
    let bytes = std::fs::read(path)?;
    let numbers: Vec<u32> = numbers
        .iter()
        .map(|n| n.parse())
        .collect::<Result<_, _>>()?;
    let threads = numbers.first().map_or(2, |&threads| threads as usize);
    let divisor = |size: &Option<Reduction>| size.map_or(1, Reduction::divisor);
    let mut timed: Vec<(Option<Reduction>, Vec<f64>)> = SIZES
        .into_iter()
        .filter(|size| numbers.get(1).is_none_or(|&only| only == divisor(size)))
        .map(|size| (size, Vec::new()))
        .collect();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    for _ in 0..TURNS {
        for (size, times_ms) in &mut timed {
            let started = Instant::now();
            pool.install(|| {
                let jpeg = Jpeg::read(&bytes)?;
                match *size {
                    None => jpeg.decode(),
                    Some(reduction) => jpeg.decode_reduced(reduction),
                }
            })?;
            times_ms.push(started.elapsed().as_secs_f64() * 1e3);
        }
    }
    for (size, times_ms) in &mut timed {
        times_ms.sort_by(f64::total_cmp);
        let (fastest, median) = (times_ms[0], times_ms[TURNS / 2]);
        writeln!(
            std::io::stdout(),
            "{threads} threads, 1/{} of the size: median {median:.1} ms, fastest {fastest:.1} ms",
            divisor(size)
        )?;
    }
    Ok(())
}
