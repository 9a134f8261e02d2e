//! Observations on real pictures: half of the places of a data set, and photos that are not on its map.

use std::collections::BTreeSet;
use std::path::PathBuf;

use grimnet_locate::Support;
use grimnet_net::Model;

use super::PhotoCount;
use super::observation::{Answer, Observation};
use super::observer::{ObserveError, Observer};
use super::trial::{SceneLocalizer, answer};
use crate::elsewhere::{self, ElsewhereOptions, Source};
use crate::scene::{HeadingMode, Scene, Shot};

/// The places of a data set that are used, by their number in the order of their names. The others are left for a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlacesUsed {
    /// The first, the third and so on.
    Odd,
    /// The second, the fourth and so on.
    Even,
}

impl PlacesUsed {
    /// Whether a data set has an answerable photo of one of these places.
    #[must_use]
    pub fn has_photos(self, scene: &Scene) -> bool {
        !self.of(scene).is_empty()
    }

    /// The answerable photos of these places with the number of their place. Photos without a place are not used.
    fn of(self, scene: &Scene) -> Vec<(usize, &Shot)> {
        let place = |shot: &Shot| shot.truth.place.clone();
        let places: BTreeSet<String> = scene.shots.iter().filter_map(place).collect();
        let places: Vec<String> = places.into_iter().collect();
        scene
            .shots
            .iter()
            .filter(|shot| shot.truth.is_answerable())
            .filter_map(|shot| {
                let number = places.binary_search(&place(shot)?).ok()?;
                let is_used = number.is_multiple_of(2) == (self == Self::Odd);
                is_used.then_some((number, shot))
            })
            .collect()
    }
}

/// Pictures with the number of their scene, the same on every map: they are on one side of a check.
#[derive(Debug, Clone)]
pub struct NumberedSource {
    /// The pictures.
    pub source: Source,
    /// The number of their scene.
    pub scene: usize,
}

/// A data set whose photos are observed.
pub struct RealScene<'a> {
    /// Map and photos.
    pub scene: &'a Scene,
    /// The places that are used; `None` for the map alone, on which only photos taken elsewhere are localised.
    pub places: Option<PlacesUsed>,
    /// Pictures that are not on the map.
    pub elsewhere: Vec<NumberedSource>,
    /// How often they are tried. The width of the map is that of `scene`.
    pub trials: ElsewhereOptions,
}

impl RealScene<'_> {
    /// How many photos [`RealScene::observe`] will localise.
    #[must_use]
    pub fn count(&self) -> PhotoCount {
        let own = self.places.map_or(0, |places| places.of(self.scene).len());
        PhotoCount {
            here: 2 * own,
            elsewhere: self.trials.trials * self.elsewhere.len(),
        }
    }

    /// Localises the photos, each with its heading known and unknown, and the pictures that are not on the map. `first_scene` is
    /// the first number of a scene that is not in use; each place is one. The pack is written to `pack`, unless it is there already.
    ///
    /// # Errors
    /// The map, the pack or a photo is refused, an observation cannot be kept, or the run was stopped.
    pub fn observe(
        &self,
        model: &Model,
        first_scene: usize,
        pack: PathBuf,
        observer: &mut Observer<'_>,
    ) -> Result<(), ObserveError> {
        let localizer = SceneLocalizer::new(model, self.scene, pack, observer.stop());
        let own = self.places.map_or(Vec::new(), |used| used.of(self.scene));
        for (place, shot) in own {
            for heading in [HeadingMode::Known, HeadingMode::Unknown] {
                observer.next(|| {
                    Ok(Observation {
                        // Places that follow each other among those used are on both sides of a check by halves.
                        scene: first_scene + place / 2,
                        elsewhere: false,
                        heading_known: heading == HeadingMode::Known,
                        real: true,
                        answer: answer(localizer.get()?, shot, heading)?,
                    })
                })?;
            }
        }
        self.observe_elsewhere(&localizer, observer)
    }

    fn observe_elsewhere(
        &self,
        localizer: &SceneLocalizer<'_>,
        observer: &mut Observer<'_>,
    ) -> Result<(), ObserveError> {
        let numbered = self.elsewhere.iter();
        let sources: Vec<Source> = numbered.map(|numbered| numbered.source.clone()).collect();
        let scene_of = |name: &str| {
            let mut numbered = self.elsewhere.iter();
            let own = numbered.find(|numbered| numbered.source.name == name);
            own.map_or(0, |numbered| numbered.scene)
        };
        elsewhere::try_each(&sources, &self.trials, &mut |make| {
            observer.next(|| {
                let trial = make(localizer.get()?);
                Ok(Observation {
                    scene: scene_of(&trial.source),
                    elsewhere: true,
                    heading_known: trial.heading_known,
                    real: true,
                    answer: trial.support.map(Answer::elsewhere),
                })
            })
        })
    }
}

impl Answer {
    /// The answer to a photo that is not on the map: any position is wrong.
    fn elsewhere(support: Support) -> Self {
        Self {
            error_east_m: f64::INFINITY,
            error_north_m: f64::INFINITY,
            level_gsd_m: f64::NAN,
            support,
        }
    }
}
