//! Robustness sweeps: one condition is varied step by step on the procedural world, and accuracy is measured at each step.

use std::path::Path;

use grimnet_photo::PhotoError;
use grimnet_world::Season;

use crate::bench::{Bench, BenchError, Setup};
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::given::Given;
use crate::photometry::Photometry;
use crate::recipe::{Recipe, Variant};
use crate::world_flight::{FlightError, PoseChange, WorldFlight};
use grimnet_eval::metrics::Summary;

/// The condition that is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sweep {
    /// Heading of the photos, known and unknown.
    Yaw,
    /// Height above ground, known and unknown.
    Scale,
    /// Camera ahead of straight down.
    Pitch,
    /// Brightness of the photos.
    Brightness,
    /// Contrast of the photos.
    Contrast,
    /// Blur of the photos.
    Blur,
    /// Noise of the photos.
    Noise,
    /// Season of the photos; the map is of summer.
    Season,
    /// Share of buildings and trees that came or went since the map.
    MapAge,
    /// Photos of another place than the map's.
    WrongArea,
    /// Heading of the photos, by the paper's procedure.
    PaperYaw,
}

impl Sweep {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Yaw,
        Self::Scale,
        Self::Pitch,
        Self::Brightness,
        Self::Contrast,
        Self::Blur,
        Self::Noise,
        Self::Season,
        Self::MapAge,
        Self::WrongArea,
        Self::PaperYaw,
    ];

    /// Its name.
    #[must_use]
    pub fn id(self) -> &'static str {
        match self {
            Self::Yaw => "yaw",
            Self::Scale => "scale",
            Self::Pitch => "pitch",
            Self::Brightness => "brightness",
            Self::Contrast => "contrast",
            Self::Blur => "blur",
            Self::Noise => "noise",
            Self::Season => "season",
            Self::MapAge => "map-age",
            Self::WrongArea => "wrong-area",
            Self::PaperYaw => "paper-yaw",
        }
    }

    /// Name of its table.
    #[must_use]
    pub fn table_id(self) -> String {
        format!("sweep-{}", self.id())
    }

    /// What is varied, in words.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Yaw => "Heading of the photos, degrees",
            Self::Scale => "Height above ground, as a factor of 100 to 130 m",
            Self::Pitch => "Camera pitch from nadir, degrees",
            Self::Brightness => "Brightness of the photos, factor",
            Self::Contrast => "Contrast of the photos, factor",
            Self::Blur => "Blur of the photos, pixels (1 sigma)",
            Self::Noise => "Gaussian noise of the photos, grey levels of 255 (1 sigma)",
            Self::Season => "Season of the photos; the map is of summer",
            Self::MapAge => {
                "Share of buildings and trees that may have changed since the map; half of these have"
            }
            Self::WrongArea => "Photos of another place than the map's: none may get a fix",
            Self::PaperYaw => {
                "Heading of the photos by the paper's procedure, degrees from the map's up"
            }
        }
    }

    /// Headings by the paper's procedure: its text claims no prior on orientation, and its recipe has none built in.
    fn paper_headings(flight: &WorldFlight) -> Vec<Step> {
        let variants = [
            (Variant::PAPER, "as published"),
            (Variant::PAPER_WITH_HEADING, "heading given"),
            (
                Variant {
                    given: Given::Scale,
                    ..Variant::PAPER_WITH_PRIOR
                },
                "map at footprint / 512",
            ),
            (
                Variant::PAPER_WITH_PRIOR,
                "map at footprint / 512, heading given",
            ),
        ];
        let step = |(variant, name): (Variant, &str), deg: f64| Step {
            name: format!("{deg}, {name}"),
            flight: WorldFlight {
                change: PoseChange::Heading(deg),
                ..flight.clone()
            },
            photometry: Photometry::Original,
            variant,
        };
        variants
            .into_iter()
            .flat_map(|variant| [0.0, 30.0, -30.0, 90.0, 180.0].map(|deg| step(variant, deg)))
            .collect()
    }

    /// The steps of the sweeps over poses.
    fn pose_steps(self, flight: &WorldFlight) -> Vec<Step> {
        let posed = |name: String, change: PoseChange, heading_known: bool| Step {
            name,
            flight: WorldFlight {
                change,
                ..flight.clone()
            },
            photometry: Photometry::Original,
            variant: default_mode(heading_known),
        };
        match self {
            Self::Scale => [0.5, 0.71, 1.0, 1.41, 2.0]
                .into_iter()
                .flat_map(|factor| {
                    [
                        posed(format!("{factor}, given"), PoseChange::Height(factor), true),
                        posed(
                            format!("{factor}, not given"),
                            PoseChange::UnreportedHeight(factor),
                            true,
                        ),
                    ]
                })
                .collect(),
            Self::Pitch => [0.0, 5.0, 10.0, 20.0, 30.0, 45.0]
                .map(|deg| posed(deg.to_string(), PoseChange::Pitch(deg), true))
                .into(),
            _ => [true, false]
                .into_iter()
                .flat_map(|known| {
                    let given = if known { "given" } else { "not given" };
                    (0..8).map(move |i| (45.0 * f64::from(i), known, given))
                })
                .map(|(deg, known, given)| {
                    posed(format!("{deg}, {given}"), PoseChange::Heading(deg), known)
                })
                .collect(),
        }
    }

    /// The steps: name, flight, change of the photos, and whether headings are known.
    fn steps(self, flight: &WorldFlight) -> Vec<Step> {
        let lit = |value: f64, photometry: Photometry| Step {
            name: value.to_string(),
            flight: flight.clone(),
            photometry,
            variant: Variant::DEFAULT_WITH_PRIOR,
        };
        let seen = |name: String, flight: WorldFlight, heading_known: bool| Step {
            name,
            flight,
            photometry: Photometry::Original,
            variant: default_mode(heading_known),
        };
        match self {
            Self::PaperYaw => Self::paper_headings(flight),
            Self::Yaw | Self::Scale | Self::Pitch => self.pose_steps(flight),
            Self::Brightness => [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0]
                .map(|f| lit(f, Photometry::Brightness(f)))
                .into(),
            Self::Contrast => [0.1, 0.2, 0.4, 0.6, 1.0, 1.5]
                .map(|f| lit(f, Photometry::Contrast(f)))
                .into(),
            Self::Blur => [0.0, 1.0, 2.0, 4.0, 8.0]
                .map(|s| lit(s, Photometry::Blur(s)))
                .into(),
            Self::Noise => [0.0, 10.0, 20.0, 40.0, 80.0]
                .map(|s| lit(s, Photometry::Noise(s)))
                .into(),
            Self::Season => Season::ALL
                .map(|season| {
                    let mut flight = flight.clone();
                    flight.photo_look.season = season;
                    seen(format!("{season:?}").to_lowercase(), flight, true)
                })
                .into(),
            Self::MapAge => [0.03, 0.1, 0.2, 0.4, 0.7, 1.0]
                .map(|share: f32| {
                    let mut flight = flight.clone();
                    flight.photo_look.change = share;
                    seen(share.to_string(), flight, true)
                })
                .into(),
            Self::WrongArea => [true, false]
                .map(|known| {
                    let flight = WorldFlight {
                        wrong_area: true,
                        ..flight.clone()
                    };
                    seen(
                        format!("heading {}", if known { "given" } else { "not given" }),
                        flight,
                        known,
                    )
                })
                .into(),
        }
    }
}

/// The default method, with the heading or without.
fn default_mode(heading_known: bool) -> Variant {
    Variant {
        recipe: Recipe::Default,
        given: if heading_known {
            Given::HeadingAndScale
        } else {
            Given::Scale
        },
    }
}

struct Step {
    name: String,
    flight: WorldFlight,
    photometry: Photometry,
    variant: Variant,
}

/// Why a sweep cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A flight cannot be rendered.
    #[error(transparent)]
    Flight(#[from] FlightError),
    /// A setup cannot be run.
    #[error(transparent)]
    Bench(Box<BenchError>),
    /// A photo cannot be read.
    #[error(transparent)]
    Photo(#[from] PhotoError),
}

impl From<BenchError> for SweepError {
    fn from(error: BenchError) -> Self {
        Self::Bench(Box::new(error))
    }
}

/// Runs a sweep over each of `flights`; maps are written into `folder`. A row a step, over all flights together.
///
/// # Errors
/// A map cannot be written, or a pack not built.
pub fn run(
    sweep: Sweep,
    bench: &mut Bench<'_>,
    flights: &[WorldFlight],
    folder: &Path,
) -> Result<ExperimentTable, SweepError> {
    let mut rows: Vec<(String, Vec<grimnet_eval::metrics::Frame>)> = Vec::new();
    for flight in flights {
        for (i, step) in sweep.steps(flight).into_iter().enumerate() {
            let mut scene = step.flight.make(folder)?;
            // The bench distinguishes scenes by name.
            scene.name = format!("{} {} {}", flight.name, sweep.id(), step.name);
            let setup = Setup {
                photometry: step.photometry,
                ..step.variant.setup(&scene)?
            };
            let frames = bench.measure(&scene, &setup)?.frames;
            if rows.len() <= i {
                rows.push((step.name, Vec::new()));
            }
            rows[i].1.extend(frames);
        }
    }
    Ok(ExperimentTable {
        id: sweep.table_id(),
        title: sweep.title().to_owned(),
        columns: vec![
            Column::percent("with a fix"),
            Column::percent("within 5 m"),
            Column::percent("within 20 m"),
            Column::metres("median"),
            Column::new("confidently wrong", "", 0),
        ],
        rows: rows
            .iter()
            .map(|(name, frames)| row(sweep, name, &Summary::of(frames)))
            .collect(),
        notes: vec![
            "Shares are of all frames; the median counts a frame without a fix as infinitely far."
                .to_owned(),
        ],
        ..ExperimentTable::default()
    })
}

fn row(sweep: Sweep, name: &str, summary: &Summary) -> Row {
    // Every fix in a wrong area is wrong, whatever its coordinates.
    let wrong = if sweep == Sweep::WrongArea {
        summary.fixes
    } else {
        summary.confidently_wrong
    };
    Row::new(
        name,
        vec![
            Some(100.0 * summary.fixes as f64 / summary.frames.max(1) as f64),
            Some(100.0 * summary.within_5m),
            Some(100.0 * summary.within_20m),
            summary.median_m,
            Some(wrong as f64),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sweep_has_distinct_steps() {
        let flight = WorldFlight::over("town", 1, 300.0, 0.5, 1);
        for sweep in Sweep::ALL {
            let steps = sweep.steps(&flight);
            assert!(steps.len() >= 2, "{sweep:?}");
            let mut names: Vec<&str> = steps.iter().map(|s| s.name.as_str()).collect();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), steps.len(), "{sweep:?}");
        }
    }
}
