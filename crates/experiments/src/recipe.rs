//! The two methods that every experiment runs, and what they are given beside the pixels.

use grimnet_eval::scene::Scene;
use grimnet_locate::Options;
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, TILE_PX};
use grimnet_photo::PhotoError;

use crate::bench::{Setup, at_gsd};
use crate::given::Given;

/// The two methods.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Recipe {
    /// The default method.
    #[default]
    Default,
    /// The paper's procedure.
    Paper,
}

/// A method with what it is given: a row of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The method.
    pub recipe: Recipe,
    /// What it is given.
    pub given: Given,
}

impl Variant {
    /// The paper's procedure as published: nothing is given, and tiles are cut from the map's own pixels.
    pub const PAPER: Self = Self {
        recipe: Recipe::Paper,
        given: Given::Nothing,
    };
    /// The default method with as little.
    pub const DEFAULT_WITHOUT_PRIOR: Self = Self {
        recipe: Recipe::Default,
        given: Given::Nothing,
    };
    /// The paper's procedure on photos that are turned by their heading, which its text does not use.
    pub const PAPER_WITH_HEADING: Self = Self {
        recipe: Recipe::Paper,
        given: Given::Heading,
    };
    /// The default method with as much.
    pub const DEFAULT_WITH_HEADING: Self = Self {
        recipe: Recipe::Default,
        given: Given::Heading,
    };
    /// The paper's procedure with what its text does not use: photos are turned by their heading, and the map is resampled so that a
    /// tile is as wide as a photo.
    pub const PAPER_WITH_PRIOR: Self = Self {
        recipe: Recipe::Paper,
        given: Given::HeadingAndScale,
    };
    /// The default method with heading and scale.
    pub const DEFAULT_WITH_PRIOR: Self = Self {
        recipe: Recipe::Default,
        given: Given::HeadingAndScale,
    };
    /// The paper's procedure and the default method with equal inputs: nothing, the heading, heading and scale.
    pub const PAIRS: [[Self; 2]; 3] = [
        [Self::PAPER, Self::DEFAULT_WITHOUT_PRIOR],
        [Self::PAPER_WITH_HEADING, Self::DEFAULT_WITH_HEADING],
        [Self::PAPER_WITH_PRIOR, Self::DEFAULT_WITH_PRIOR],
    ];
    /// Those of the tables with many rows: both methods with nothing, and both with heading and scale.
    pub const SWEPT: [Self; 4] = [
        Self::PAPER,
        Self::DEFAULT_WITHOUT_PRIOR,
        Self::PAPER_WITH_PRIOR,
        Self::DEFAULT_WITH_PRIOR,
    ];

    /// The setup for photos of a scene.
    ///
    /// # Errors
    /// A photo cannot be read.
    pub fn setup(self, scene: &Scene) -> Result<Setup, PhotoError> {
        let setup = self.plain_setup();
        let is_scaled = matches!(self.given, Given::Scale | Given::HeadingAndScale);
        if self.recipe != Recipe::Paper || !is_scaled {
            return Ok(setup);
        }
        let width_m = scene.ground_width_m()?;
        Ok(match width_m {
            Some(width_m) => Setup {
                build: at_gsd(setup.build, width_m / f64::from(TILE_PX)),
                ..setup
            },
            None => setup,
        })
    }

    /// The setup without what depends on a scene.
    #[must_use]
    pub fn plain_setup(self) -> Setup {
        let (build, options) = match self.recipe {
            Recipe::Default => (BuildOptions::standard(), Options::default()),
            Recipe::Paper => (BuildOptions::paper(), Options::paper()),
        };
        Setup {
            build,
            options: Options {
                turn_by_heading: matches!(self.given, Given::Heading | Given::HeadingAndScale),
                ..options
            },
            given: self.given,
            ..Setup::default()
        }
    }

    /// Its name in tables, with `model`.
    #[must_use]
    pub fn name(self, model: &Model) -> String {
        let method = match self.recipe {
            Recipe::Default => "default mode".to_owned(),
            Recipe::Paper => paper_name(model),
        };
        match (self.recipe, self.given) {
            (Recipe::Paper, Given::Nothing) => method,
            (Recipe::Paper, Given::Heading) => format!("{method}; heading given"),
            (Recipe::Paper, Given::Scale) => format!("{method}; map at footprint / 512"),
            (Recipe::Paper, Given::HeadingAndScale) => {
                format!("{method}; heading given, map at footprint / 512")
            }
            (Recipe::Default, given) => format!("{method}; {}", given.words()),
        }
    }
}

/// What the paper's procedure is called with this network.
fn paper_name(model: &Model) -> String {
    let spec = model.spec();
    if spec.differences_from_paper().is_empty() {
        "paper's procedure and network".to_owned()
    } else {
        format!("paper's procedure, {} network", spec.preset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_say_which_network_runs_the_papers_procedure() {
        let compact = Model::bundled().unwrap();
        assert_eq!(
            Variant::PAPER.name(&compact),
            "paper's procedure, compact network"
        );
        let all = Variant::PAIRS.concat();
        let mut names: Vec<String> = all.iter().map(|v| v.name(&compact)).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 6);
    }

    #[test]
    fn the_published_row_gets_no_heading() {
        assert!(!Variant::PAPER.plain_setup().options.turn_by_heading);
        assert_eq!(Variant::PAPER.plain_setup().options, Options::paper());
        assert!(
            Variant::PAPER_WITH_PRIOR
                .plain_setup()
                .options
                .turn_by_heading
        );
    }
}
