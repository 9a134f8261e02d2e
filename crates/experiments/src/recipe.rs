//! The two methods that every experiment runs, and what they are told of the photos.

use grimnet_eval::scene::Scene;
use grimnet_locate::Options;
use grimnet_net::Model;
use grimnet_pack::{BuildOptions, TILE_PX};
use grimnet_photo::PhotoError;

use crate::bench::{Setup, at_gsd};
use crate::told::Told;

/// The two methods.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Recipe {
    /// The default method.
    #[default]
    Default,
    /// The paper's procedure.
    Paper,
}

/// A method with what it is told: a row of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    /// The method.
    pub recipe: Recipe,
    /// What it is told.
    pub told: Told,
}

impl Variant {
    /// The paper's procedure as published: nothing is told, and tiles are cut from the map's own pixels.
    pub const PAPER: Self = Self {
        recipe: Recipe::Paper,
        told: Told::Nothing,
    };
    /// The default method with as little.
    pub const DEFAULT_UNTOLD: Self = Self {
        recipe: Recipe::Default,
        told: Told::Nothing,
    };
    /// The paper's procedure with what its text does not use: photos are turned by their heading, and the map is resampled so that a
    /// tile is as wide as a photo.
    pub const PAPER_TOLD: Self = Self {
        recipe: Recipe::Paper,
        told: Told::HeadingAndScale,
    };
    /// The default method with heading and scale.
    pub const DEFAULT_TOLD: Self = Self {
        recipe: Recipe::Default,
        told: Told::HeadingAndScale,
    };
    /// All four: within each half the inputs are equal.
    pub const ALL: [Self; 4] = [
        Self::PAPER,
        Self::DEFAULT_UNTOLD,
        Self::PAPER_TOLD,
        Self::DEFAULT_TOLD,
    ];
    /// Those of the tables with many rows. [`Variant::DEFAULT_UNTOLD`], which searches over headings and scales, is left to the tables
    /// that compare methods.
    pub const SWEPT: [Self; 3] = [Self::PAPER, Self::PAPER_TOLD, Self::DEFAULT_TOLD];

    /// The setup for photos of a scene.
    ///
    /// # Errors
    /// A photo cannot be read.
    pub fn setup(self, scene: &Scene) -> Result<Setup, PhotoError> {
        let setup = self.plain_setup();
        if self.recipe != Recipe::Paper || self.told == Told::Nothing {
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
                turn_by_heading: self.told == Told::HeadingAndScale,
                ..options
            },
            told: self.told,
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
        match (self.recipe, self.told) {
            (Recipe::Paper, Told::Nothing) => method,
            (Recipe::Paper, Told::Scale) => format!("{method}; map at footprint / 512"),
            (Recipe::Paper, Told::HeadingAndScale) => {
                format!("{method}; heading told, map at footprint / 512")
            }
            (Recipe::Default, Told::Nothing) => format!("{method}; nothing told"),
            (Recipe::Default, Told::Scale) => format!("{method}; scale told"),
            (Recipe::Default, Told::HeadingAndScale) => format!("{method}; heading and scale told"),
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
        let mut names: Vec<String> = Variant::ALL.map(|v| v.name(&compact)).into();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 4);
    }

    #[test]
    fn the_published_row_gets_no_heading() {
        assert!(!Variant::PAPER.plain_setup().options.turn_by_heading);
        assert_eq!(Variant::PAPER.plain_setup().options, Options::paper());
        assert!(Variant::PAPER_TOLD.plain_setup().options.turn_by_heading);
    }
}
