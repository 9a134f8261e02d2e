//! What the filter costs: an input in order, a fix that comes five seconds late, and a point of the track.

#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use grimnet_track::{
    Input, TrackOptions, Tracker,
    simulation::{Flight, FlightOptions},
};

/// Two minutes of a flight with wrong fixes: a tracker with a full lag, and what comes next.
fn tracked() -> (Tracker, Vec<Input>) {
    let flight = Flight::new(FlightOptions {
        duration_s: 150.0,
        alias_share: 0.2,
        ..FlightOptions::default()
    });
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    let mut next = Vec::new();
    for delivered in &flight.deliveries {
        if delivered.arrival_s < 120.0 {
            tracker.push(delivered.input).unwrap();
        } else {
            next.push(delivered.input);
        }
    }
    (tracker, next)
}

fn filter(criterion: &mut Criterion) {
    let (tracker, next) = tracked();
    let mut group = criterion.benchmark_group("filter");
    // The time of one input is that over their number.
    group.throughput(Throughput::Elements(next.len() as u64));
    group.bench_function("30 s of inputs in order", |bencher| {
        bencher.iter_batched(
            || tracker.clone(),
            |mut tracker| {
                for input in &next {
                    tracker.push(*input).unwrap();
                }
                tracker
            },
            BatchSize::LargeInput,
        );
    });
    group.finish();
    let mut ahead = tracker.clone();
    for input in &next {
        ahead.push(*input).unwrap();
    }
    let late = next
        .iter()
        .rev()
        .find(|input| matches!(input, Input::Fix(fix) if fix.time_s < 145.0))
        .copied()
        .unwrap();
    let late = match late {
        Input::Fix(mut fix) => {
            fix.time_s += 0.01;
            Input::Fix(fix)
        }
        other => other,
    };
    criterion.bench_function("a fix five seconds late", |bencher| {
        bencher.iter_batched(
            || ahead.clone(),
            |mut tracker| {
                tracker.push(late).unwrap();
                tracker
            },
            BatchSize::LargeInput,
        );
    });
    criterion.bench_function("a point of the track", |bencher| {
        bencher.iter(|| tracker.point_at(121.0));
    });
}

criterion_group!(benches, filter);
criterion_main!(benches);
