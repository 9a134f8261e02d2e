//! Times the network on this machine, for comparison with `benches/peers/network.py`.
//!
//! ```text
//! cargo run --release -p grimnet-net --example time_network -- compact 320 [f32|int8] [THREADS...]
//! ```
//!
//! `network` is everything up to the heatmap, the descriptor field and the global descriptor, from an image of bytes;
//! `features` also selects and describes 1024 keypoints; `own statistics` is `network` normalised with the image's own
//! statistics. The weights are random, which does not change the time; the whitening projection is int8, as in the bundled model.

use std::error::Error;
use std::io::Write;
use std::time::{Duration, Instant};

use grimnet_net::{DataType, Domain, ExtractOptions, Extractor, Model, NetSpec, Precision};
use image::{Rgb, RgbImage};

/// How long each figure is measured.
const MEASURE: Duration = Duration::from_secs(2);
const WARM_UP_RUNS: usize = 3;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [preset, side, threads @ ..] = &arguments[..] else {
        return Err("usage: time_network compact|vgg16 SIDE_PX [f32|int8] [THREADS...]".into());
    };
    let (precision, threads) = match threads {
        [name, rest @ ..] if name.parse::<usize>().is_err() => (name.parse()?, rest),
        _ => (Precision::F32, threads),
    };
    let spec = NetSpec::preset(preset).ok_or("the presets are compact and vgg16")?;
    let side: u32 = side.parse()?;
    let threads: Vec<usize> = threads
        .iter()
        .map(|t| t.parse())
        .collect::<Result<_, _>>()?;
    let threads = if threads.is_empty() {
        vec![2, 1]
    } else {
        threads
    };
    let model = Model::random(&spec, 0)?
        .with_whitening_precision(DataType::I8)?
        .with_precision(precision)?;
    let extractor = Extractor::new(&model, Domain::Uav)?;
    let picture = RgbImage::from_fn(side, side, |x, y| {
        let noise = (x.wrapping_mul(0x9e37_79b9) ^ y.wrapping_mul(0x85eb_ca6b))
            .wrapping_mul(0xc2b2_ae35)
            >> 25;
        Rgb([(x / 3) as u8, (y / 2) as u8, noise as u8])
    });
    let options = ExtractOptions {
        threshold: 0.015,
        ..ExtractOptions::default()
    };
    let whole = [0, 0, side, side];
    for threads in threads {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        let network = || -> Result<usize, grimnet_net::NetError> {
            let dense = extractor.dense(&picture, None)?;
            Ok(model.global_descriptor(&dense.vlad(whole, None)).len())
        };
        let features = || {
            extractor
                .extract(&picture, None, &options)
                .map(|features| features.keypoints.len())
        };
        let own = || -> Result<usize, grimnet_net::NetError> {
            let (dense, _) = extractor.dense_instance(&picture, None)?;
            Ok(model.global_descriptor(&dense.vlad(whole, None)).len())
        };
        let found = features()?;
        let [network, features, own] =
            pool.install(|| [measure(network), measure(features), measure(own)]);
        let (network, features, own) = (network?, features?, own?);
        writeln!(
            std::io::stdout(),
            "grimnet {preset} {precision} {side} px threads {threads}: network {network}; features ({found} keypoints) {features}; own statistics {own}",
        )?;
    }
    Ok(())
}

/// Median and best time of single runs.
fn measure<E>(run: impl Fn() -> Result<usize, E>) -> Result<String, E> {
    for _ in 0..WARM_UP_RUNS {
        run()?;
    }
    let (mut times, start) = (Vec::new(), Instant::now());
    while start.elapsed() < MEASURE || times.len() < 5 {
        let start = Instant::now();
        run()?;
        times.push(start.elapsed());
    }
    times.sort_unstable();
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    Ok(format!(
        "median {:.2} ms, best {:.2} ms",
        ms(times[times.len() / 2]),
        ms(times[0])
    ))
}
