//! `grim eval --track --world SEED`: flights over procedural towns, and simulated hours.

use std::cell::OnceCell;
use std::io::Write;
use std::sync::Arc;

use anyhow::Result;
use grimnet_eval::tracks::about::TrackAbout;
use grimnet_eval::tracks::figures::ThreeFigures;
use grimnet_eval::tracks::figures_table::ROWS;
use grimnet_eval::tracks::rendered::{FlownFrames, RenderedFlight, RenderedPlan};
use grimnet_eval::tracks::results::{TRACK_FILES, TrackResults};
use grimnet_eval::tracks::simulated::{FixStatistics, simulate};
use grimnet_eval::tracks::stored_flight::{read_stored_flight, stored_flight};
use grimnet_eval::tracks::three_runs::{FlightRuns, ThreeRuns};
use grimnet_eval::tracks::town::Town;
use grimnet_locate::Localizer;
use grimnet_output::OutputFolder;
use grimnet_track::TrackOptions;
use indicatif::ProgressBar;

use super::eval_track_options::{TrackEvalOptions, flown_area};
use super::results::print_report_path;
use crate::exit::Exit;
use crate::procedural_flight::make_town;
use crate::progress;
use crate::standard_output::StandardOutput;

/// Folder of the flights that are done.
const FLIGHTS: &str = "flights";

/// How frames are searched over a town whose map and pack are written to a folder.
pub trait TownSearch {
    /// What the search depends on besides the town, in words.
    fn conditions(&self) -> String;

    /// Draws the map and builds the pack.
    ///
    /// # Errors
    /// They cannot be written.
    fn open(&self, town: &Town, folder: &OutputFolder) -> Result<Arc<Localizer>>;
}

/// Renders and simulates flights over towns, writes the results and prints the figures. Flights that are in the folder are not
/// rendered again.
///
/// # Errors
/// A frame cannot be searched, or results not be written.
pub fn fly(
    options: &TrackEvalOptions,
    seed: u64,
    search: &dyn TownSearch,
    folder: &OutputFolder,
    about: TrackAbout,
) -> Result<Exit> {
    let flights = folder.subfolder(FLIGHTS)?;
    let mut rendered: Vec<(RenderedFlight, FlightRuns)> = Vec::new();
    let mut runs = ThreeRuns::default();
    for (number, town_seed) in (0..).zip(options.town_seeds(seed)) {
        let town = make_town(town_seed)?;
        let plans = options.plans(seed, number, flown_area(&town)?);
        // The first town's map lies in the folder itself, as that of other evaluations does.
        let town_folder = match number {
            0 => folder.clone(),
            _ => folder.subfolder(&format!("world-{town_seed}"))?,
        };
        let over = OverTown {
            search,
            conditions: format!("world {town_seed}, {}", search.conditions()),
            town,
            town_folder,
            localizer: OnceCell::new(),
        };
        let frames = plans.iter().map(RenderedPlan::frame_count).sum();
        let bar = progress::bar(frames, &format!("flying over town {town_seed}"), "frames");
        for plan in plans {
            let flown = over.flown(&plan, &flights, &bar)?;
            let flight = plan.flown(flown);
            let of_flight = FlightRuns::new(&flight.flight, &flight.flown.options)?;
            runs.add_runs(&flight.flight, &of_flight, &flight.flown.options)?;
            rendered.push((flight, of_flight));
        }
        bar.finish_and_clear();
    }
    let fixes = FixStatistics::of(rendered.iter().flat_map(|(flight, _)| &flight.flown.frames));
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
    print_report_path(folder, &TRACK_FILES)?;
    Ok(Exit::Done)
}

/// Flights over one town, whose map is drawn when the first of them is not in the folder.
struct OverTown<'a> {
    search: &'a dyn TownSearch,
    conditions: String,
    town: Town,
    town_folder: OutputFolder,
    localizer: OnceCell<Arc<Localizer>>,
}

impl OverTown<'_> {
    /// What the frames of a flight gave: from the folder, else they are rendered, searched and put there.
    fn flown(
        &self,
        plan: &RenderedPlan,
        flights: &OutputFolder,
        bar: &ProgressBar,
    ) -> Result<FlownFrames> {
        let conditions = format!("{}, {plan:?}", self.conditions);
        let name = format!("flight-{}.json", plan.flight.seed);
        if let Some(flown) = read_stored_flight(&flights.path().join(&name), &conditions) {
            bar.inc(plan.frame_count());
            return Ok(flown);
        }
        flights.check([&name])?;
        let track = TrackOptions {
            vehicle: plan.flight.vehicle,
            ..TrackOptions::default()
        };
        let localizer = self.localizer()?;
        let flown = plan.fly(&self.town, localizer, &track, &mut || bar.inc(1))?;
        flights.write_bytes(&name, &stored_flight(&conditions, &flown)?)?;
        Ok(flown)
    }

    fn localizer(&self) -> Result<&Arc<Localizer>> {
        if let Some(localizer) = self.localizer.get() {
            return Ok(localizer);
        }
        let opened = self.search.open(&self.town, &self.town_folder)?;
        Ok(self.localizer.get_or_init(|| opened))
    }
}

/// Width of the column of names, and of each run's column.
const NAME_WIDTH: usize = 28;
const RUN_WIDTH: usize = 30;

fn print(what: &str, figures: &ThreeFigures) -> Result<()> {
    let mut out = StandardOutput;
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
