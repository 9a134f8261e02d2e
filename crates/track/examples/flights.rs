//! Simulated flights: three runs for each scenario, figures per instant.
//!
//! `cargo run --release -p grimnet-track --features simulation --example flights -- [FLIGHTS] [SCENARIO]`

#![allow(clippy::print_stdout)]

use grimnet_track::{
    TrackOptions, Vehicle,
    measure::{Measure, TrackSummary, time_to_locate_s},
    simulation::{Camera, Confidence, Flight, FlightOptions, Gaps, Runs},
};

/// Every scenario by name. A table: its length is that of its rows.
fn scenarios() -> Vec<(&'static str, FlightOptions)> {
    let base = FlightOptions::default();
    let gaps_30 = Some(Gaps {
        shortest_s: 30.0,
        longest_s: 30.0,
        apart_s: 120.0,
    });
    let gaps_120 = Some(Gaps {
        shortest_s: 10.0,
        longest_s: 120.0,
        apart_s: 90.0,
    });
    let plane = FlightOptions {
        vehicle: Vehicle::Plane,
        ..base.clone()
    };
    // Photos of a survey, one every 20 s.
    let sparse = FlightOptions {
        frame_rate_hz: 0.05,
        duration_s: 1800.0,
        velocity: false,
        attitude: false,
        ..base.clone()
    };
    vec![
        ("sparse", sparse.clone()),
        (
            "sparse-clean",
            FlightOptions {
                alias_share: 0.0,
                ..sparse.clone()
            },
        ),
        (
            "sparse-aliases30",
            FlightOptions {
                alias_share: 0.3,
                ..sparse.clone()
            },
        ),
        (
            "sparse-hostile",
            FlightOptions {
                confidence: Confidence::Hostile,
                ..sparse.clone()
            },
        ),
        (
            "sparse-plane",
            FlightOptions {
                vehicle: Vehicle::Plane,
                ..sparse.clone()
            },
        ),
        (
            "sparse-motion",
            FlightOptions {
                motion: true,
                ..sparse.clone()
            },
        ),
        (
            "sparse-velocity",
            FlightOptions {
                velocity: true,
                attitude: true,
                ..sparse
            },
        ),
        (
            "plain",
            FlightOptions {
                alias_share: 0.0,
                ..base.clone()
            },
        ),
        (
            "gaps30",
            FlightOptions {
                gaps: gaps_30,
                ..base.clone()
            },
        ),
        (
            "gaps30-plane",
            FlightOptions {
                gaps: gaps_30,
                ..plane.clone()
            },
        ),
        (
            "gimbal",
            FlightOptions {
                gaps: gaps_30,
                camera: Camera::Gimbal,
                ..base.clone()
            },
        ),
        (
            "gaps120",
            FlightOptions {
                gaps: gaps_120,
                ..base.clone()
            },
        ),
        (
            "aliases20",
            FlightOptions {
                gaps: gaps_30,
                alias_share: 0.2,
                ..base.clone()
            },
        ),
        (
            "aliases40",
            FlightOptions {
                gaps: gaps_30,
                alias_share: 0.4,
                ..base.clone()
            },
        ),
        (
            "hostile10",
            FlightOptions {
                alias_share: 0.1,
                confidence: Confidence::Hostile,
                ..base.clone()
            },
        ),
        (
            "hostile40",
            FlightOptions {
                alias_share: 0.4,
                confidence: Confidence::Hostile,
                ..base.clone()
            },
        ),
        (
            "late",
            FlightOptions {
                gaps: gaps_30,
                latest_s: 5.0,
                ..base.clone()
            },
        ),
        (
            "elsewhere",
            FlightOptions {
                put_elsewhere_s: Some(300.0),
                ..base.clone()
            },
        ),
        (
            "elsewhere-clean",
            FlightOptions {
                put_elsewhere_s: Some(300.0),
                alias_share: 0.0,
                ..base.clone()
            },
        ),
        (
            "elsewhere-single",
            FlightOptions {
                put_elsewhere_s: Some(300.0),
                alias_frames: 1.0,
                ..base.clone()
            },
        ),
        (
            "elsewhere-aliases20",
            FlightOptions {
                put_elsewhere_s: Some(300.0),
                alias_share: 0.2,
                ..base.clone()
            },
        ),
        (
            "no-velocity",
            FlightOptions {
                velocity: false,
                gaps: gaps_30,
                ..base.clone()
            },
        ),
        (
            "no-velocity-plane",
            FlightOptions {
                velocity: false,
                gaps: gaps_30,
                ..plane.clone()
            },
        ),
        (
            "motion",
            FlightOptions {
                velocity: false,
                motion: true,
                gaps: gaps_30,
                ..base.clone()
            },
        ),
        (
            "no-attitude",
            FlightOptions {
                attitude: false,
                gaps: gaps_30,
                ..base.clone()
            },
        ),
        (
            "one-hertz",
            FlightOptions {
                frame_rate_hz: 1.0,
                gaps: gaps_30,
                ..base.clone()
            },
        ),
        (
            "five-hertz",
            FlightOptions {
                frame_rate_hz: 5.0,
                gaps: gaps_30,
                ..base
            },
        ),
    ]
}

fn line(name: &str, summary: &TrackSummary) {
    let metres = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2}"));
    let share =
        |value: Option<f64>| value.map_or("-".into(), |value| format!("{:.1}", 100.0 * value));
    println!(
        "  {name:12} answered {:5.1} % | median {:>6} p90 {:>6} p99 {:>7} m | <5 m {:5.1} <10 m {:5.1} <25 m {:5.1} % | gap {:6.1} s | wrong {} | 50 % {} 95 % {} 99 % {} | NEES {}",
        100.0 * summary.answered,
        metres(summary.median_m),
        metres(summary.p90_m),
        metres(summary.p99_m),
        100.0 * summary.availability_5m,
        100.0 * summary.availability_10m,
        100.0 * summary.availability_25m,
        summary.longest_gap_s,
        summary.confidently_wrong,
        share(summary.ellipse50_holds),
        share(summary.ellipse95_holds),
        share(summary.ellipse99_holds),
        metres(summary.mean_nees),
    );
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let flights: u64 = arguments.next().map_or(Ok(20), |text| text.parse())?;
    let wanted = arguments.next();
    for (name, base) in scenarios() {
        if wanted.as_deref().is_some_and(|wanted| wanted != name) {
            continue;
        }
        let track = TrackOptions {
            vehicle: base.vehicle,
            ..TrackOptions::default()
        };
        let mut measures = [Measure::default(), Measure::default(), Measure::default()];
        let (mut first_s, mut again_frames, mut never) = (Vec::new(), Vec::new(), 0);
        for seed in 0..flights {
            let flight = Flight::new(FlightOptions {
                seed: seed + 1,
                ..base.clone()
            });
            let runs = Runs::new(&flight, &track)?;
            let tracks = [&runs.fixes_only, &runs.motion_only, &runs.filter];
            for (measure, track) in measures.iter_mut().zip(tracks) {
                measure.add_flight(track);
            }
            first_s.extend(time_to_locate_s(&runs.filter, 0.0));
            if let Some(at_s) = base.put_elsewhere_s {
                match time_to_locate_s(&runs.filter, at_s) {
                    Some(seconds) => again_frames.push(seconds * base.frame_rate_hz),
                    None => never += 1,
                }
            }
        }
        println!("{name}: {flights} flights");
        for (run, measure) in ["fixes only", "motion only", "filter"]
            .iter()
            .zip(&measures)
        {
            line(run, &measure.summary());
        }
        first_s.sort_by(f64::total_cmp);
        let last = first_s.len().saturating_sub(1);
        if let (Some(median_s), Some(longest_s)) = (first_s.get(last / 2), first_s.last()) {
            println!(
                "  first fix: median {median_s:.1} s, longest {longest_s:.1} s, in {} flights",
                first_s.len()
            );
        }
        if base.put_elsewhere_s.is_some() {
            again_frames.sort_by(f64::total_cmp);
            let at = |share: f64| again_frames[((again_frames.len() - 1) as f64 * share) as usize];
            println!(
                "  relocalised after frames: median {:.0}, p90 {:.0}, most {:.0}; never {never}",
                at(0.5),
                at(0.9),
                at(1.0)
            );
        }
    }
    Ok(())
}
