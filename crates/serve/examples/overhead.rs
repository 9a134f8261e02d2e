//! What the service adds to a localisation, and how many health probes it answers while localisations run.
//!
//! Usage: cargo run --release -p grimnet-serve --example overhead -- AREA.grim PHOTO.jpg [PAIRS]
//!
//! With `RAYON_NUM_THREADS=1` both sides compute on one thread, which makes them vary less.

#![allow(clippy::print_stdout, reason = "an example prints")]

use std::error::Error;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use grimnet_locate::{Localizer, Prior};
use grimnet_photo::{Photo, QUERY_LONG_SIDE_PX};
use grimnet_serve::{Access, Limits, ServedMap, Service};

/// Time for which health probes are counted.
const PROBING: Duration = Duration::from_secs(5);

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [pack, photo, rest @ ..] = &arguments[..] else {
        return Err("expected a pack and a photo".into());
    };
    let repeats: usize = rest.first().map_or(Ok(40), |text| text.parse())?;
    let bytes = std::fs::read(photo)?;
    let direct = Localizer::open(pack)?;
    let map = ServedMap::new("area", Localizer::open(pack)?, None)?;
    let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
    let limits = Limits {
        at_once: 2,
        ..Limits::default()
    };
    let service = Service::bind(any_port, Access::ThisMachine, vec![map], limits)?;
    let (address, stop) = (service.address(), service.stop_handle());
    std::thread::scope(|scope| {
        let serving = scope.spawn(move || service.run(false));
        let measured =
            overhead(&direct, address, &bytes, repeats).and_then(|()| probes(address, &bytes));
        stop.stop();
        match serving.join() {
            Ok(served) => served?,
            Err(_) => return Err("the service panicked".into()),
        }
        measured
    })
}

/// Takes turns between library and service, and prints medians with quartiles: of both, of the differences of pairs, and of what the
/// service adds by its own clock, which noise of the localisation itself does not touch.
fn overhead(direct: &Localizer, address: SocketAddr, bytes: &[u8], repeats: usize) -> Result<()> {
    let (mut library_ms, mut service_ms) = (vec![], vec![]);
    let (mut difference_ms, mut added_ms) = (vec![], vec![]);
    for pair in 0..=repeats {
        let library = || -> Result<f64> {
            let start = Instant::now();
            let photo = Photo::from_bytes("photo", bytes, Some(QUERY_LONG_SIDE_PX))?;
            direct.locate(&photo, &Prior::none())?;
            Ok(start.elapsed().as_secs_f64() * 1e3)
        };
        let service = || -> Result<(f64, f64)> {
            let before_ms = localised_ms(address)?;
            let start = Instant::now();
            locate(address, bytes)?;
            let served_ms = start.elapsed().as_secs_f64() * 1e3;
            Ok((served_ms, served_ms - (localised_ms(address)? - before_ms)))
        };
        // What drifts favours neither.
        let (alone_ms, (served_ms, beside_ms)) = if pair % 2 == 0 {
            let alone_ms = library()?;
            (alone_ms, service()?)
        } else {
            let served = service()?;
            (library()?, served)
        };
        // The first pair fills caches.
        if pair > 0 {
            library_ms.push(alone_ms);
            service_ms.push(served_ms);
            difference_ms.push(served_ms - alone_ms);
            added_ms.push(beside_ms);
        }
    }
    println!("{repeats} pairs; median (quartiles), ms");
    println!("library: {}", spread(&mut library_ms));
    println!("service: {}", spread(&mut service_ms));
    println!("difference of pairs: {}", spread(&mut difference_ms));
    println!(
        "service without decoding and localising: {}",
        spread(&mut added_ms)
    );
    Ok(())
}

/// Time that the service spent decoding and localising so far, by its own clock, milliseconds.
fn localised_ms(address: SocketAddr) -> Result<f64> {
    let request = format!("GET /metrics HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n");
    let mut stream = TcpStream::connect(address)?;
    stream.write_all(request.as_bytes())?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    let line = answer
        .lines()
        .find_map(|line| line.strip_prefix("grimnet_localisation_seconds_sum "))
        .ok_or("the service does not tell its times")?;
    Ok(line.trim().parse::<f64>()? * 1e3)
}

/// Counts health probes on one connection while two localisations run.
fn probes(address: SocketAddr, bytes: &[u8]) -> Result<()> {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let done = &done;
        let locating: Vec<_> = (0..2)
            .map(|_| {
                scope.spawn(move || {
                    let mut count = 0;
                    while !done.load(Ordering::Relaxed) && locate(address, bytes).is_ok() {
                        count += 1;
                    }
                    count
                })
            })
            .collect();
        let counted = probe(address);
        done.store(true, Ordering::Relaxed);
        let located: usize = locating
            .into_iter()
            .filter_map(|thread| thread.join().ok())
            .sum();
        let (count, slowest) = counted?;
        println!(
            "healthz: {:.0} a second, the slowest {:.1} ms, while {located} photos were localised",
            count as f64 / PROBING.as_secs_f64(),
            slowest.as_secs_f64() * 1e3
        );
        Ok(())
    })
}

/// Number of probes that were answered, and the longest time of one.
fn probe(address: SocketAddr) -> Result<(usize, Duration)> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_nodelay(true)?;
    let request = format!("GET /healthz HTTP/1.1\r\nhost: {address}\r\n\r\n");
    let (start, mut count, mut slowest) = (Instant::now(), 0, Duration::ZERO);
    let mut buffer = [0; 4096];
    while start.elapsed() < PROBING {
        let sent = Instant::now();
        stream.write_all(request.as_bytes())?;
        let mut got = Vec::new();
        while !got.ends_with(b"ok\n") {
            let length = stream.read(&mut buffer)?;
            if length == 0 {
                return Err("the service closed the connection".into());
            }
            got.extend_from_slice(&buffer[..length]);
        }
        slowest = slowest.max(sent.elapsed());
        count += 1;
    }
    Ok((count, slowest))
}

fn locate(address: SocketAddr, bytes: &[u8]) -> Result<()> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_nodelay(true)?;
    let head = format!(
        "POST /v1/locate HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\ncontent-type: image/jpeg\r\ncontent-length: {}\r\n\r\n",
        bytes.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(bytes)?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    if answer.starts_with("HTTP/1.1 200") {
        Ok(())
    } else {
        Err(answer.into())
    }
}

/// Median and quartiles.
fn spread(values: &mut [f64]) -> String {
    values.sort_by(f64::total_cmp);
    let at = |share: usize| {
        let value = values.get(values.len() * share / 4);
        value.copied().unwrap_or(f64::NAN)
    };
    format!("{:.2} ({:.2} to {:.2})", at(2), at(1), at(3))
}
