//! Times the filter: an input that comes in order, a fix that comes five seconds late, and a point of the track.
//!
//! ```text
//! cargo run --release -p grimnet-track --features simulation --example time_filter
//! ```

use std::error::Error;
use std::hint::black_box;
use std::io::Write;
use std::time::Instant;

use grimnet_track::{
    Input, TrackOptions, Tracker,
    simulation::{Flight, FlightOptions},
};

/// Times that are taken of each.
const TURNS: usize = 200;
/// Points of the track in one time, which are too short to be taken singly.
const POINTS: u32 = 1_000;

/// Two minutes of a flight with wrong fixes: a tracker with a full lag, and the inputs of the next half a minute.
fn tracked() -> Result<(Tracker, Vec<Input>), Box<dyn Error>> {
    let flight = Flight::new(FlightOptions {
        duration_s: 150.0,
        alias_share: 0.2,
        ..FlightOptions::default()
    });
    let mut tracker = Tracker::new(TrackOptions::default())?;
    let mut next = Vec::new();
    for delivered in &flight.deliveries {
        if delivered.arrival_s < 120.0 {
            tracker.push(delivered.input)?;
        } else {
            next.push(delivered.input);
        }
    }
    Ok((tracker, next))
}

/// The median of [`TURNS`] times of `work`, microseconds, each on a copy of `tracker`.
fn median_us(
    tracker: &Tracker,
    work: impl Fn(&mut Tracker) -> Result<(), Box<dyn Error>>,
) -> Result<f64, Box<dyn Error>> {
    let mut times_us = Vec::with_capacity(TURNS);
    for _ in 0..TURNS {
        let mut tracker = tracker.clone();
        let start = Instant::now();
        work(&mut tracker)?;
        times_us.push(start.elapsed().as_secs_f64() * 1e6);
    }
    times_us.sort_by(f64::total_cmp);
    Ok(times_us[TURNS / 2])
}

fn main() -> Result<(), Box<dyn Error>> {
    let (tracker, next) = tracked()?;
    let mut ahead = tracker.clone();
    for &input in &next {
        ahead.push(input)?;
    }
    let late = next.iter().rev().find_map(|input| match input {
        Input::Fix(fix) if fix.time_s < 145.0 => Some(*fix),
        _ => None,
    });
    let mut late = late.ok_or("the flight has no fix before 145 s")?;
    // Another one than that which the filter has.
    late.time_s += 0.01;

    let in_order = median_us(&tracker, |tracker| {
        next.iter()
            .try_for_each(|&input| Ok(tracker.push(input).map(drop)?))
    })?;
    let late = median_us(&ahead, |tracker| {
        Ok(tracker.push(Input::Fix(late)).map(drop)?)
    })?;
    let points = median_us(&tracker, |tracker| {
        for _ in 0..POINTS {
            black_box(tracker.point_at(black_box(121.0)));
        }
        Ok(())
    })?;
    writeln!(
        std::io::stdout(),
        "30 s of inputs in order, {}: {in_order:.0} us, {:.2} us each; a fix five seconds late: {late:.1} us; a point of the track: {:.2} us",
        next.len(),
        in_order / next.len() as f64,
        points / f64::from(POINTS)
    )?;
    Ok(())
}
