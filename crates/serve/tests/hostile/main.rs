//! Thousands of hostile requests of every kind, many at once: none crashes the service, fills its memory or keeps others out.
//!
//! A usual run sends a few hundred. `GRIM_HOSTILE_REQUESTS` sets another number and prints how they were answered, and the memory.
//! `GRIM_HOSTILE_ADDRESS` sends them to a service that runs already, without a token.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

#[path = "../service/area.rs"]
#[allow(dead_code, reason = "shared with the other tests of the service")]
mod area;
mod bodies;
#[path = "../service/client.rs"]
#[allow(dead_code, reason = "shared with the other tests of the service")]
mod client;
mod clients;
mod heads;
mod kind;
mod kinds;
mod memory;
mod pictures;
mod request;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use grimnet_serve::Limits;

use area::{Running, area};
use client::{get, send};
use kind::{Kind, Outcome};
use kinds::kinds;

/// Requests of a usual run.
const REQUESTS: usize = 400;

/// Clients at the same time.
const CLIENTS: usize = 32;

/// Memory that the service may take beyond what it had before, MiB: requests that run and wait, connections, tiles.
const MAX_GROWTH_MIB: u64 = 512;

/// Pause between two probes.
const PROBE_PAUSE: Duration = Duration::from_millis(20);

/// Sizes by default, and little patience. The queue has room: a full one would refuse most requests before they do harm.
fn impatient() -> Limits {
    Limits {
        queue: 4 * CLIENTS,
        body_pause: Duration::from_millis(300),
        body_time: Duration::from_millis(1500),
        head_time: Duration::from_millis(300),
        write_pause: Duration::from_millis(300),
        ..Limits::default()
    }
}

/// How often each kind of request had each outcome.
type Outcomes = BTreeMap<(&'static str, Outcome), usize>;

/// Sends requests of all kinds in turn, from many clients at once.
fn attack(address: SocketAddr, kinds: &[Kind], requests: usize) -> Outcomes {
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        let clients: Vec<_> = (0..CLIENTS)
            .map(|_| {
                scope.spawn(|| {
                    let mut outcomes = Outcomes::new();
                    loop {
                        let number = next.fetch_add(1, Ordering::Relaxed);
                        if number >= requests {
                            return outcomes;
                        }
                        let kind = Kind::of_number(kinds, number);
                        let outcome = kind.send(address, number);
                        assert!(
                            kind.allows(outcome),
                            "request {number}, {}: {outcome}",
                            kind.name
                        );
                        *outcomes.entry((kind.name, outcome)).or_default() += 1;
                    }
                })
            })
            .collect();
        let mut all = Outcomes::new();
        for client in clients {
            for (key, count) in client.join().unwrap() {
                *all.entry(key).or_default() += count;
            }
        }
        all
    })
}

/// Number of health probes that were answered until `done`, and the longest time of one.
fn probe(address: SocketAddr, done: &AtomicBool) -> (usize, Duration) {
    let (mut count, mut slowest) = (0, Duration::ZERO);
    while !done.load(Ordering::Relaxed) {
        let start = Instant::now();
        assert_eq!(get(address, "/healthz").status, 200);
        slowest = slowest.max(start.elapsed());
        count += 1;
        std::thread::sleep(PROBE_PAUSE);
    }
    (count, slowest)
}

/// Tells another thread to end when it is dropped.
struct Ending<'a>(&'a AtomicBool);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

fn report(outcomes: &Outcomes) -> String {
    let mut by_outcome: BTreeMap<Outcome, usize> = BTreeMap::new();
    let mut text = String::new();
    for ((kind, outcome), count) in outcomes {
        *by_outcome.entry(*outcome).or_default() += count;
        let _ = writeln!(text, "  {kind}: {outcome} {count} times");
    }
    for (outcome, count) in by_outcome {
        let _ = writeln!(text, "{outcome}: {count}");
    }
    text
}

#[test]
fn hostile_requests_harm_nobody() {
    let told: Option<usize> = std::env::var("GRIM_HOSTILE_REQUESTS")
        .ok()
        .map(|text| text.parse().unwrap());
    let elsewhere: Option<SocketAddr> = std::env::var("GRIM_HOSTILE_ADDRESS")
        .ok()
        .map(|text| text.parse().unwrap());
    let running = match elsewhere {
        None => Some(Running::on_area(impatient())),
        Some(_) => None,
    };
    let address = elsewhere
        .or(running.as_ref().map(|running| running.address))
        .unwrap();
    let photo = &area().photo;
    let locate = || {
        let headers = ["content-type: image/jpeg"];
        let answer = send(address, "POST /v1/locate", &headers, photo);
        assert_eq!(answer.status, 200, "{}", answer.text());
        answer.json()["state"].clone()
    };
    // What a localisation takes for itself is not counted.
    let state = locate();
    let kinds = kinds(address, photo);
    memory::forget_peak();
    let before = memory::now();
    let (done, requests) = (AtomicBool::new(false), told.unwrap_or(REQUESTS));
    let start = Instant::now();
    let (outcomes, (probes, slowest)) = std::thread::scope(|scope| {
        let probing = scope.spawn(|| probe(address, &done));
        // Also if a client fails.
        let _ending = Ending(&done);
        let outcomes = attack(address, &kinds, requests);
        done.store(true, Ordering::Relaxed);
        (outcomes, probing.join().unwrap())
    });
    let took = start.elapsed();
    // Everything is given back, and photos are localised as before.
    let idle = [
        "grimnet_localisations_running 0\n",
        "grimnet_localisations_waiting 0\n",
        "grimnet_connections 1\n",
    ];
    while !idle
        .iter()
        .all(|line| get(address, "/metrics").text().contains(line))
    {}
    assert_eq!(locate(), state);
    assert_eq!(outcomes.values().sum::<usize>(), requests);
    let after = memory::now();
    if told.is_some() {
        let mut out = std::io::stderr();
        let _ = writeln!(
            out,
            "{}{requests} requests of {} kinds from {CLIENTS} clients in {:.0} s; {probes} health probes beside them, the slowest {:.2} s",
            report(&outcomes),
            kinds.len(),
            took.as_secs_f64(),
            slowest.as_secs_f64(),
        );
        if let (None, Some(before), Some(after)) = (elsewhere, before, after) {
            let _ = writeln!(
                out,
                "resident memory: {} MiB before, {} MiB at most, {} MiB after",
                before.now_mib, after.peak_mib, after.now_mib
            );
        }
    }
    if let (None, Some(before), Some(after)) = (elsewhere, before, after) {
        let growth_mib = after.peak_mib.saturating_sub(before.now_mib);
        assert!(growth_mib < MAX_GROWTH_MIB, "{before:?} {after:?}");
    }
}
