//! `grim eval --track`: flights over a procedural town, simulated hours, and hidden fixes of a real flight.

use std::io::Write;
use std::sync::Arc;

use anyhow::{Result, bail};
use clap::Args;
use grimnet_eval::metrics::statistics::percentile;
use grimnet_eval::scene::{HeadingMode, Scene};
use grimnet_eval::tracks::about::TrackAbout;
use grimnet_eval::tracks::exif_time::seconds_of_exif_time;
use grimnet_eval::tracks::figures::ThreeFigures;
use grimnet_eval::tracks::figures_table::ROWS;
use grimnet_eval::tracks::ground_cover::covered_legs;
use grimnet_eval::tracks::hidden::{HiddenError, TimedShot, predict_hidden};
use grimnet_eval::tracks::hidden_figures::figures;
use grimnet_eval::tracks::hidden_results::hidden_files;
use grimnet_eval::tracks::rendered::{CAMERA, RenderedFlight, RenderedPlan};
use grimnet_eval::tracks::results::TrackResults;
use grimnet_eval::tracks::simulated::{FixStatistics, simulate};
use grimnet_eval::tracks::three_runs::{FlightRuns, ThreeRuns};
use grimnet_eval::tracks::town::Town;
use grimnet_locate::Localizer;
use grimnet_output::OutputFolder;
use grimnet_photo::Photo;
use grimnet_track::simulation::{Camera, FlightArea, FlightOptions};
use grimnet_track::{TrackOptions, Vehicle};

use crate::exit::Exit;
use crate::progress;
use crate::values;

/// The longest flight, seconds: a longer evaluation has several.
const LONGEST_FLIGHT_S: f64 = 600.0;
/// The flight in which the aircraft is put elsewhere: its length and when, seconds.
const KIDNAPPED_S: [f64; 2] = [36.0, 20.0];
/// Part of the town that is flown over: a photo near the edge shows little of the map.
const FLOWN_SHARE: f64 = 0.72;
/// Mean time between legs over water and snow, seconds.
const LEGS_APART_S: f64 = 90.0;
/// Legs of short flights are not longer than this part of the flight.
const LONGEST_LEG_SHARE: f64 = 0.2;
/// The longest leg over water or snow, seconds.
const LONGEST_LEG_S: f64 = 120.0;

/// Options of `grim eval --track`.
#[derive(Debug, Args)]
pub struct TrackEvalOptions {
    /// Evaluate the track of flights: with --world flights that are rendered frame by frame and simulated ones, with FOLDER its
    /// photos in order of time, of which one to four in a row are hidden
    ///
    /// Three runs are compared: fixes only, motion only, and the filter. Writes track_summary.json, track_report.html and tables
    /// to the folder of results.
    #[arg(long, help_heading = "Tracks")]
    track: bool,

    /// Minutes of flight that are rendered, in flights of at most ten
    #[arg(
        long,
        value_name = "M",
        value_parser = values::minutes,
        allow_hyphen_values = true,
        default_value_t = 4.0,
        requires = "track",
        help_heading = "Tracks"
    )]
    minutes: f64,

    /// Frames a second
    #[arg(
        long,
        value_name = "HZ",
        value_parser = values::frame_rate_hz,
        allow_hyphen_values = true,
        default_value_t = 2.0,
        requires = "track",
        help_heading = "Tracks"
    )]
    frame_rate: f64,

    /// Flights of ten minutes that are simulated from the statistics of the rendered fixes, with aliases; 0 for none
    #[arg(
        long,
        value_name = "N",
        default_value_t = 60,
        requires = "track",
        help_heading = "Tracks"
    )]
    simulated_flights: u32,
}

impl TrackEvalOptions {
    /// Whether tracks are evaluated.
    pub fn is_asked(&self) -> bool {
        self.track
    }

    /// The flights: vehicles, cameras and delays take turns, and one in which the aircraft is put elsewhere.
    fn plans(&self, seed: u64, town: &Town) -> Result<Vec<RenderedPlan>> {
        let total_s = 60.0 * self.minutes;
        let count = (total_s / LONGEST_FLIGHT_S).ceil().max(1.0);
        let middle_m = [0.5 * town.world.size_m(); 2];
        let area = FlightArea {
            centre: town.lonlat(middle_m)?,
            half_side_m: 0.5 * FLOWN_SHARE * town.world.size_m(),
        };
        let mut plans = Vec::new();
        for index in 0..count as u64 {
            let (vehicle, vehicle_name) = if index % 2 == 0 {
                (Vehicle::Multirotor, "multirotor")
            } else {
                (Vehicle::Plane, "plane")
            };
            let (camera, camera_name) = if index / 2 % 2 == 0 {
                (Camera::Fixed, "fixed camera")
            } else {
                (Camera::Gimbal, "gimbal")
            };
            let latest_s = if index % 3 == 2 { 5.0 } else { 0.0 };
            let flight = FlightOptions {
                seed: seed.wrapping_mul(1000).wrapping_add(index),
                duration_s: total_s / count,
                frame_rate_hz: self.frame_rate,
                vehicle,
                camera,
                latest_s,
                motion: true,
                focal_length_px: CAMERA.focal_px(),
                area: Some(area),
                ..FlightOptions::default()
            };
            let longest_s = (LONGEST_LEG_SHARE * flight.duration_s).clamp(10.0, LONGEST_LEG_S);
            plans.push(RenderedPlan {
                name: format!(
                    "flight {}: {vehicle_name}, {camera_name}, fixes up to {latest_s} s late",
                    index + 1
                ),
                legs: covered_legs(flight.duration_s, longest_s, LEGS_APART_S, flight.seed),
                flight,
            });
        }
        let [duration_s, put_elsewhere_s] = KIDNAPPED_S;
        plans.extend(plans.first().cloned().map(|first| RenderedPlan {
            name: "put elsewhere".to_owned(),
            flight: FlightOptions {
                seed: first.flight.seed ^ 0xe15e,
                duration_s,
                put_elsewhere_s: Some(put_elsewhere_s),
                ..first.flight
            },
            legs: Vec::new(),
        }));
        Ok(plans)
    }
}

/// Renders and simulates flights over a town, writes the results and prints the figures.
///
/// # Errors
/// A frame cannot be searched, or results not be written.
pub fn fly(
    options: &TrackEvalOptions,
    seed: u64,
    town: &Town,
    localizer: &Arc<Localizer>,
    folder: &OutputFolder,
    about: TrackAbout,
) -> Result<Exit> {
    let plans = options.plans(seed, town)?;
    let frames: u64 = plans.iter().map(RenderedPlan::frame_count).sum();
    let bar = progress::bar(frames, "flying", "frames");
    let mut rendered: Vec<(RenderedFlight, FlightRuns)> = Vec::new();
    let mut runs = ThreeRuns::default();
    for plan in plans {
        let track = TrackOptions {
            vehicle: plan.flight.vehicle,
            ..TrackOptions::default()
        };
        let flown = plan.fly(town, localizer, &track, &mut || bar.inc(1))?;
        let of_flight = FlightRuns::new(&flown.flight, &flown.options)?;
        runs.add_runs(&flown.flight, &of_flight, &flown.options)?;
        rendered.push((flown, of_flight));
    }
    bar.finish_and_clear();
    let fixes = FixStatistics::of(rendered.iter().flat_map(|(flight, _)| &flight.frames));
    let simulated = (options.simulated_flights > 0)
        .then(|| {
            let flights = u64::from(options.simulated_flights);
            let bar = progress::bar(flights, "simulating", "flights");
            let base = TrackOptions::default();
            let figures = simulate(flights, Some(&fixes), &base, &mut || bar.inc(1))?;
            bar.finish_and_clear();
            anyhow::Ok(figures)
        })
        .transpose()?;
    let results = TrackResults {
        about,
        rendered,
        figures: runs.figures(),
        fixes,
        simulated,
    };
    for (name, content) in results.files()? {
        folder.write_bytes(name, &content)?;
    }
    print("rendered", &results.figures)?;
    if let Some(simulated) = &results.simulated {
        print("simulated", simulated)?;
    }
    Ok(Exit::Done)
}

/// Hides fixes of a real flight and predicts them.
///
/// # Errors
/// A photo cannot be read or has no time, or results cannot be written.
pub fn hide(
    scene: &Scene,
    localizer: &Localizer,
    folder: &OutputFolder,
    about: TrackAbout,
) -> Result<Exit> {
    let mut shots = Vec::new();
    for (index, shot) in scene.shots.iter().enumerate() {
        let photo = shot.photo.open()?;
        let Some(time_s) = photo
            .metadata
            .captured_at
            .as_deref()
            .and_then(seconds_of_exif_time)
        else {
            let photo = shot.name.clone();
            bail!(HiddenError::NoTime { photo });
        };
        let timed = TimedShot {
            name: shot.name.clone(),
            time_s,
            truth: shot.truth.position,
            known: shot.prior(HeadingMode::Known, photo.full_size_px),
        };
        shots.push((index, timed));
    }
    shots.sort_by(|(_, a), (_, b)| a.time_s.total_cmp(&b.time_s));
    let (order, shots): (Vec<usize>, Vec<TimedShot>) = shots.into_iter().unzip();
    let gaps_s: Vec<f64> = shots
        .windows(2)
        .map(|pair| pair[1].time_s - pair[0].time_s)
        .collect();
    let bar = progress::bar(shots.len() as u64, "searching", "photos");
    let mut open = |at: usize| -> Result<Photo> {
        bar.inc(1);
        let photo = scene.shots[order[at]].photo.open()?;
        Ok(photo.as_ref().clone())
    };
    let predictions = predict_hidden(localizer, &shots, &TrackOptions::default(), &mut open)?;
    bar.finish_and_clear();
    let figures = figures(&predictions);
    for (name, content) in hidden_files(&about, &figures, &predictions)? {
        folder.write_bytes(name, &content)?;
    }
    let mut out = std::io::stdout().lock();
    let metres = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.1} m"));
    writeln!(
        out,
        "{} photos, {:.0} s apart (median)",
        shots.len(),
        percentile(&gaps_s, 0.5).unwrap_or(0.0)
    )?;
    writeln!(
        out,
        "hidden  predictions  joined  distance  fixes only  motion only    filter  joined  stated radius"
    )?;
    for f in &figures {
        writeln!(
            out,
            "{:>6}{:>13}{:>8}{:>10}{:>12}{:>13}{:>10}{:>8}{:>15}",
            f.hidden,
            f.predictions,
            f.joined,
            metres(f.distance_median_m),
            metres(f.fixes_only_median_m),
            metres(f.motion_only_median_m),
            metres(f.filter_median_m),
            metres(f.filter_joined_median_m),
            metres(f.radius95_median_m),
        )?;
    }
    Ok(Exit::Done)
}

/// Width of the column of names, and of each run's column.
const NAME_WIDTH: usize = 28;
const RUN_WIDTH: usize = 30;

fn print(what: &str, figures: &ThreeFigures) -> Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "\n{what}: {} flights, {:.2} h",
        figures.flights, figures.hours
    )?;
    let runs = figures.runs();
    write!(out, "{:<NAME_WIDTH$}", "")?;
    for (name, _) in runs {
        write!(out, "{name:>RUN_WIDTH$}")?;
    }
    writeln!(out)?;
    for (name, cell) in ROWS {
        write!(out, "{name:<NAME_WIDTH$}")?;
        for (_, run) in runs {
            write!(out, "{:>RUN_WIDTH$}", cell(run))?;
        }
        writeln!(out)?;
    }
    Ok(())
}
