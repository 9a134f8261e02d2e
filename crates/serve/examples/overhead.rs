//! What the service adds to a localisation, and how many health probes it answers while localisations run.
//!
//! Usage: cargo run --release -p grimnet-serve --example overhead -- AREA.grim PHOTO.jpg [REPEATS]

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
    let repeats: usize = rest.first().map_or(Ok(15), |text| text.parse())?;
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

/// Takes turns between library and service, and prints the medians and the median of the differences of pairs.
fn overhead(direct: &Localizer, address: SocketAddr, bytes: &[u8], repeats: usize) -> Result<()> {
    let (mut library_ms, mut service_ms, mut difference_ms) = (vec![], vec![], vec![]);
    for _ in 0..repeats {
        let start = Instant::now();
        let photo = Photo::from_bytes("photo", bytes, Some(QUERY_LONG_SIDE_PX))?;
        direct.locate(&photo, &Prior::none())?;
        let alone = start.elapsed().as_secs_f64() * 1e3;
        let start = Instant::now();
        locate(address, bytes)?;
        let served = start.elapsed().as_secs_f64() * 1e3;
        library_ms.push(alone);
        service_ms.push(served);
        difference_ms.push(served - alone);
    }
    println!("library: median {:.1} ms", median(&mut library_ms));
    println!("service: median {:.1} ms", median(&mut service_ms));
    println!(
        "median difference of pairs: {:.1} ms",
        median(&mut difference_ms)
    );
    Ok(())
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

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
