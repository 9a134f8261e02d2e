//! SIFT as a method to be measured: against every tile of a level, or against the tiles that a localiser retrieves (the paper's G + S,
//! with the paper's geometry where the localiser is in paper mode).

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};

use grimnet_eval::evaluation::{Found, Method, MethodError};
use grimnet_eval::metrics::ScoredFix;
use grimnet_eval::scene::{HeadingMode, Scene};
use grimnet_geo::LonLat;
use grimnet_locate::{Localizer, Prior};
use grimnet_pack::Mode;
use grimnet_photo::{Photo, PhotoError};

use crate::changed::Change;
use crate::paper_sift::PaperSift;
use crate::sift_map::{SiftMap, SiftMapError};

/// SIFT features of levels of packs, made once.
#[derive(Default)]
pub(crate) struct SiftMaps {
    maps: HashMap<(PathBuf, usize), SiftMap>,
    /// Of packs of paper mode, which have one level.
    paper: HashMap<PathBuf, PaperSift>,
}

/// SIFT against the tiles of the level that the localiser would compare a photo with first.
pub(crate) struct Sift<'a> {
    maps: &'a SiftMaps,
    localizer: &'a Localizer,
    /// Whether only the tiles that the localiser retrieves are matched.
    among_retrieved: bool,
}

/// Why SIFT features cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SiftMethodError {
    /// The map or a photo on it.
    #[error(transparent)]
    Map(#[from] SiftMapError),
    /// A photo.
    #[error(transparent)]
    Photo(#[from] PhotoError),
}

impl SiftMaps {
    /// Makes the features of every level that a photo of `scene` needs, changed as `change` says; the time of a frame does not count them.
    ///
    /// # Errors
    /// The map or a photo cannot be read.
    pub fn method<'a>(
        &'a mut self,
        localizer: &'a Localizer,
        scene: &Scene,
        (heading, change): (HeadingMode, Change),
        among_retrieved: bool,
    ) -> Result<Sift<'a>, SiftMethodError> {
        if among_retrieved && localizer.options().mode == Mode::Paper {
            self.add_paper(localizer, scene)?;
        } else {
            self.add_levels(localizer, scene, (heading, change))?;
        }
        Ok(Sift {
            maps: self,
            localizer,
            among_retrieved,
        })
    }

    fn add_paper(&mut self, localizer: &Localizer, scene: &Scene) -> Result<(), SiftMethodError> {
        let pack = localizer.pack();
        if let Entry::Vacant(place) = self.paper.entry(pack.path().to_owned())
            && let Some(level) = pack.levels().first()
        {
            place.insert(PaperSift::new(scene.map.as_ref(), level)?);
        }
        Ok(())
    }

    fn add_levels(
        &mut self,
        localizer: &Localizer,
        scene: &Scene,
        (heading, change): (HeadingMode, Change),
    ) -> Result<(), SiftMethodError> {
        for shot in &scene.shots {
            let photo = shot.photo.open()?;
            let (photo, prior) = change.of(&photo, &shot.prior(heading, photo.full_size_px));
            let Some(level) = localizer.first_level(&photo, &prior) else {
                continue;
            };
            let pack = localizer.pack();
            let key = (pack.path().to_owned(), level);
            if let Entry::Vacant(place) = self.maps.entry(key) {
                place.insert(SiftMap::new(scene.map.as_ref(), &pack.levels()[level])?);
            }
        }
        Ok(())
    }

    fn get(&self, pack: &Path, level: usize) -> Option<&SiftMap> {
        self.maps.get(&(pack.to_owned(), level))
    }
}

impl Method for Sift<'_> {
    fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
        let pack = self.localizer.pack();
        let among = self
            .among_retrieved
            .then(|| self.localizer.retrieve(photo, prior))
            .transpose()?;
        let level = self.localizer.first_level(photo, prior);
        // Features of the paper's procedure are for the tiles that it retrieves; all tiles are compared in default mode's way.
        let of_paper = self.maps.paper.get(pack.path());
        let found = if let (Some(map), Some(among), Some(level)) = (of_paper, &among, level) {
            map.locate(self.localizer, &pack.levels()[level], (photo, prior), among)?
        } else if let Some(map) = level.and_then(|level| self.maps.get(pack.path(), level)) {
            map.locate(photo, prior, among.as_deref())?
        } else {
            return Err("no SIFT features were made of the level that this photo needs".into());
        };
        Ok(Found {
            fix: found.map(|fix| without_covariance(fix.position)),
            reason: Some("no transform is consistent with any matches".to_owned()),
            inliers: found.map(|fix| fix.inliers),
            ..Found::default()
        })
    }
}

fn without_covariance(position: LonLat) -> ScoredFix {
    ScoredFix {
        position,
        covariance_en_m2: [1.0, 0.0, 1.0],
        radius95_m: 0.0,
    }
}
