//! Robustness sweeps: one condition is varied step by step on the procedural world, and the accuracy of default mode and of the paper's
//! procedure is measured at each step.

use std::path::Path;

use grimnet_photo::PhotoError;
use grimnet_world::Season;

use crate::bench::{Bench, BenchError, Setup};
use crate::experiment_table::{Column, ExperimentTable, Row};
use crate::given::Given;
use crate::photometry::Photometry;
use crate::recipe::{Recipe, Variant};
use crate::world_flight::{FlightError, PoseChange, WorldFlight};
use grimnet_eval::metrics::{Frame, Summary};
use grimnet_eval::scene::Scene;

/// The condition that is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sweep {
    /// Heading of the photos, under all that the methods can be given: the paper's text claims no prior on orientation.
    Yaw,
    /// Height above ground, reported right and wrong.
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
}

impl Sweep {
    /// All of them.
    pub const ALL: [Self; 10] = [
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
            Self::Yaw => "Heading of the photos, degrees from the map's up",
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
        }
    }

    /// The steps over `flight`.
    fn steps(self, flight: &WorldFlight) -> Vec<Step> {
        let all = Given::HeadingAndScale;
        match self {
            Self::Yaw => [
                Given::Nothing,
                Given::Heading,
                Given::Scale,
                Given::HeadingAndScale,
            ]
            .into_iter()
            .flat_map(|given| {
                [-90.0, -30.0, 0.0, 30.0, 45.0, 90.0, 135.0, 180.0].map(|deg| {
                    let name = format!("{deg}, {}", given.words());
                    Step::with_pose(flight, name, PoseChange::Heading(deg), given)
                })
            })
            .collect(),
            Self::Scale => [0.5, 0.71, 1.0, 1.41, 2.0]
                .into_iter()
                .flat_map(|factor| {
                    [
                        Step::with_pose(
                            flight,
                            format!("{factor}, reported"),
                            PoseChange::Height(factor),
                            all,
                        ),
                        Step::with_pose(
                            flight,
                            format!("{factor}, reported as 1"),
                            PoseChange::UnreportedHeight(factor),
                            all,
                        ),
                    ]
                })
                .collect(),
            Self::Pitch => [0.0, 5.0, 10.0, 20.0, 30.0, 45.0]
                .map(|deg| Step::with_pose(flight, deg.to_string(), PoseChange::Pitch(deg), all))
                .into(),
            Self::Brightness => [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0]
                .map(|f| Step::with_photometry(flight, f, Photometry::Brightness(f)))
                .into(),
            Self::Contrast => [0.1, 0.2, 0.4, 0.6, 1.0, 1.5]
                .map(|f| Step::with_photometry(flight, f, Photometry::Contrast(f)))
                .into(),
            Self::Blur => [0.0, 1.0, 2.0, 4.0, 8.0]
                .map(|s| Step::with_photometry(flight, s, Photometry::Blur(s)))
                .into(),
            Self::Noise => [0.0, 10.0, 20.0, 40.0, 80.0]
                .map(|s| Step::with_photometry(flight, s, Photometry::Noise(s)))
                .into(),
            Self::Season => Season::ALL
                .map(|season| {
                    let mut flight = flight.clone();
                    flight.photo_look.season = season;
                    Step::over(flight, format!("{season:?}").to_lowercase())
                })
                .into(),
            Self::MapAge => [0.03, 0.1, 0.2, 0.4, 0.7, 1.0]
                .map(|share: f32| {
                    let mut flight = flight.clone();
                    flight.photo_look.change = share;
                    Step::over(flight, share)
                })
                .into(),
            Self::WrongArea => [Given::HeadingAndScale, Given::Scale]
                .map(|given| {
                    let flight = WorldFlight {
                        wrong_area: true,
                        ..flight.clone()
                    };
                    Step {
                        given,
                        ..Step::over(flight, given.words())
                    }
                })
                .into(),
        }
    }
}

/// One value of the condition.
struct Step {
    name: String,
    flight: WorldFlight,
    photometry: Photometry,
    given: Given,
}

impl Step {
    /// The photos of `flight` as they are, localised with heading and scale.
    fn over(flight: WorldFlight, name: impl ToString) -> Self {
        Self {
            name: name.to_string(),
            flight,
            photometry: Photometry::Original,
            given: Given::HeadingAndScale,
        }
    }

    /// As [`Step::over`], with another camera pose.
    fn with_pose(flight: &WorldFlight, name: String, change: PoseChange, given: Given) -> Self {
        let flight = WorldFlight {
            change,
            ..flight.clone()
        };
        Self {
            given,
            ..Self::over(flight, name)
        }
    }

    /// As [`Step::over`], with the photos' pixels changed.
    fn with_photometry(flight: &WorldFlight, value: f64, photometry: Photometry) -> Self {
        Self {
            photometry,
            ..Self::over(flight.clone(), value)
        }
    }

    /// This step by a method, over its scene.
    fn setup(&self, recipe: Recipe, scene: &Scene) -> Result<Setup, PhotoError> {
        let variant = Variant {
            recipe,
            given: self.given,
        };
        Ok(Setup {
            photometry: self.photometry,
            ..variant.setup(scene)?
        })
    }
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

/// A row: its name, and the frames by default mode and by the paper's procedure.
type Frames = (String, [Vec<Frame>; 2]);

/// Runs a sweep over each of `flights`, by default mode and by the paper's procedure; maps are written into `folder`. A row a step,
/// over all flights together.
///
/// # Errors
/// A map cannot be written, or a pack not built.
pub fn run(
    sweep: Sweep,
    bench: &mut Bench<'_>,
    flights: &[WorldFlight],
    folder: &Path,
) -> Result<ExperimentTable, SweepError> {
    let mut rows: Vec<Frames> = Vec::new();
    for flight in flights {
        let map = flight.draw_map(folder)?;
        // Steps that change what is given or the light share their photos.
        let mut drawn: Vec<(WorldFlight, Scene)> = Vec::new();
        for (i, step) in sweep.steps(flight).into_iter().enumerate() {
            let at = match drawn.iter().position(|(flown, _)| *flown == step.flight) {
                Some(at) => at,
                None => {
                    let mut scene = step.flight.over_map(&map)?;
                    // The bench distinguishes scenes by name.
                    scene.name = format!("{} {} {}", flight.name, sweep.id(), drawn.len());
                    drawn.push((step.flight.clone(), scene));
                    drawn.len() - 1
                }
            };
            let scene = &drawn[at].1;
            if rows.len() <= i {
                rows.push((step.name.clone(), Default::default()));
            }
            for (recipe, frames) in RECIPES.into_iter().zip(&mut rows[i].1) {
                let setup = step.setup(recipe, scene)?;
                frames.extend(bench.measure(scene, &setup)?.frames);
            }
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
            Column::percent("paper's procedure: with a fix"),
            Column::percent("paper's procedure: within 20 m"),
            Column::metres("paper's procedure: median"),
        ],
        rows: rows
            .iter()
            .map(|(name, frames)| row(sweep, name, frames.each_ref().map(|f| Summary::of(f))))
            .collect(),
        notes: vec![
            "Shares are of all frames; the median counts a frame without a fix as infinitely far."
                .to_owned(),
            format!(
                "The first five columns are default mode's, the last three of the {}. Both are given heading and scale where the row does not say \
                 otherwise. The paper's text uses neither: its procedure turns photos by a given heading, and with a given scale its map has \
                 footprint / 512.",
                Variant::PAPER.name(bench.model())
            ),
        ],
        ..ExperimentTable::default()
    })
}

/// The methods of a row, in the order of its columns.
const RECIPES: [Recipe; 2] = [Recipe::Default, Recipe::Paper];

fn row(sweep: Sweep, name: &str, [default, paper]: [Summary; 2]) -> Row {
    let with_a_fix =
        |summary: &Summary| Some(100.0 * summary.fixes as f64 / summary.frames.max(1) as f64);
    // Every fix in a wrong area is wrong, whatever its coordinates.
    let wrong = if sweep == Sweep::WrongArea {
        default.fixes
    } else {
        default.confidently_wrong
    };
    Row::new(
        name,
        vec![
            with_a_fix(&default),
            Some(100.0 * default.within_5m),
            Some(100.0 * default.within_20m),
            default.median_m,
            Some(wrong as f64),
            with_a_fix(&paper),
            Some(100.0 * paper.within_20m),
            paper.median_m,
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
