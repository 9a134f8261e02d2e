//! Runs ways to answer over scenes, and keeps what was measured.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use grimnet_locate::{Localizer, LocateError, Options, Outcome};
use grimnet_net::{Domain, Model};
use grimnet_pack::{BuildOptions, Levels, Pack, PackError, build};
use grimnet_photo::{Metadata, Photo};

use crate::photometry::Photometry;
use crate::scene::{Scene, Shot};
use crate::sift_map::{SiftMap, SiftMapError};
use grimnet_eval::metrics::{Frame, ScoredFix};
use grimnet_eval::rank_distance::FrameDistances;
use grimnet_eval::recall::{FrameRecall, MOST_RANKS, RightTile};

/// What answers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Method {
    /// Retrieval and matching by the network.
    #[default]
    Learned,
    /// SIFT against every tile of the map.
    SiftWholeMap,
    /// SIFT against the tiles that the network retrieved (the paper's G + S).
    SiftAmongRetrieved,
}

/// One way to answer photos.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Setup {
    /// What answers.
    pub method: Method,
    /// How the pack is built.
    pub build: BuildOptions,
    /// How photos are localised.
    pub options: Options,
    /// What is done to the photos first.
    pub photometry: Photometry,
    /// Photos are normalised with this domain's statistics instead of their own.
    pub photos_as: Option<Domain>,
    /// Whether the headings are told.
    pub heading_known: bool,
}

/// What one setup gave on one scene.
#[derive(Debug, Clone, Default)]
pub struct Measured {
    /// Frame by frame.
    pub frames: Vec<Frame>,
    /// Ranks of the first tile that covers the truth; empty for setups without a search.
    pub covers: Vec<FrameRecall>,
    /// Ranks of the first tile whose centre lies within the paper's radius of the truth.
    pub near: Vec<FrameRecall>,
    /// Distances of the first tiles; empty for setups without a search.
    pub distances: Vec<FrameDistances>,
}

/// A setup could not be run.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The pack.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The localiser.
    #[error(transparent)]
    Locate(#[from] LocateError),
    /// The baseline.
    #[error(transparent)]
    Sift(#[from] SiftMapError),
    /// The folder for packs.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Runs setups over scenes.
pub struct Bench<'a> {
    model: &'a Model,
    folder: PathBuf,
    measured: HashMap<String, Measured>,
    sift_maps: HashMap<PathBuf, SiftMap>,
}

impl<'a> Bench<'a> {
    /// A bench for one model; packs are kept in `folder`.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn new(model: &'a Model, folder: &Path) -> Result<Self, BenchError> {
        fs_err::create_dir_all(folder)?;
        Ok(Self {
            model,
            folder: folder.to_owned(),
            measured: HashMap::new(),
            sift_maps: HashMap::new(),
        })
    }

    /// Answers all photos of a scene; what was measured before is not measured again. Scenes are told apart by their names.
    ///
    /// # Errors
    /// The pack cannot be built, or the localiser refuses its options. A photo that is refused counts as a frame without a fix.
    pub fn measure(&mut self, scene: &Scene, setup: &Setup) -> Result<Measured, BenchError> {
        let key = format!("{} {setup:?}", scene.name);
        if let Some(measured) = self.measured.get(&key) {
            return Ok(measured.clone());
        }
        tracing::info!("{}: {:?}, {:?}", scene.name, setup.method, setup.photometry);
        let pack_path = self.pack(scene, &setup.build)?;
        let pack = Pack::open(&pack_path)?;
        let mut localizer =
            Localizer::new(self.model.clone(), pack)?.with_options(setup.options.clone());
        if let Some(domain) = setup.photos_as {
            localizer = localizer.seeing_photos_as(domain)?;
        }
        if setup.method != Method::Learned && !self.sift_maps.contains_key(&pack_path) {
            // The level that the localiser takes for these photos, whose tiles retrieval names.
            let pack = localizer.pack();
            let level = scene.ground_width_m().map_or(0, |width_m| {
                pack.nearest_level(width_m / setup.options.query_width_px)
            });
            let map = SiftMap::new(scene.map.as_ref(), &pack.levels()[level])?;
            self.sift_maps.insert(pack_path.clone(), map);
        }
        let mut measured = Measured::default();
        for shot in &scene.shots {
            let photo = Photo {
                image: setup.photometry.apply(&shot.photo.image),
                ..copy_of(&shot.photo)
            };
            self.answer(&localizer, &pack_path, shot, &photo, setup, &mut measured)?;
        }
        self.measured.insert(key, measured.clone());
        Ok(measured)
    }

    /// Answers all photos of a scene by two networks that know nothing of each other (the paper's G + M): `retrieval`'s finds tiles,
    /// `k` of them, and this bench's matches in each; the fix with the most inliers wins.
    ///
    /// # Errors
    /// As [`Bench::measure`].
    pub fn measure_apart(
        &self,
        retrieval: &Bench<'_>,
        scene: &Scene,
        setup: &Setup,
        k: usize,
    ) -> Result<Measured, BenchError> {
        let options = Options {
            top_k: k,
            ..setup.options.clone()
        };
        let finder = Localizer::new(
            retrieval.model.clone(),
            Pack::open(retrieval.pack(scene, &setup.build)?)?,
        )?
        .with_options(options);
        let matcher = Localizer::new(
            self.model.clone(),
            Pack::open(self.pack(scene, &setup.build)?)?,
        )?
        .with_options(setup.options.clone());
        let level = match (scene.ground_width_m(), finder.pack()) {
            (Some(width_m), pack) => {
                &pack.levels()[pack.nearest_level(width_m / setup.options.query_width_px)]
            }
            (None, pack) => &pack.levels()[0],
        };
        let reach_m = level.tile_m() * std::f64::consts::FRAC_1_SQRT_2;
        let mut measured = Measured::default();
        for shot in &scene.shots {
            let prior = shot.prior(setup.heading_known);
            let since = Instant::now();
            let mut best: Option<(usize, Outcome)> = None;
            for tile in finder.retrieve(&shot.photo, &prior)? {
                let centre = level.lonlat_from_level_px(level.tile(tile).centre_px)?;
                let outcome = matcher.locate(&shot.photo, &prior.near(centre, reach_m))?;
                let inliers = outcome.fix().map_or(0, |fix| fix.inliers);
                if best.as_ref().is_none_or(|(most, _)| inliers > *most) {
                    best = Some((inliers, outcome));
                }
            }
            let mut frame = best.map_or_else(
                || Frame::missed(&shot.name, "no tile was retrieved"),
                |(_, outcome)| frame_of(shot, &outcome),
            );
            frame.time_ms = Some(since.elapsed().as_secs_f64() * 1e3);
            measured.frames.push(frame);
        }
        Ok(measured)
    }

    fn pack(&self, scene: &Scene, options: &BuildOptions) -> Result<PathBuf, BenchError> {
        let mut hasher = blake3::Hasher::new();
        let map = scene.map.content_hash().map_err(SiftMapError::from)?;
        hasher.update(&map);
        hasher.update(format!("{options:?}").as_bytes());
        hasher.update(self.model.hash().as_bytes());
        let path = self
            .folder
            .join(format!("{}.grim", &hasher.finalize().to_hex()[..16]));
        build(scene.map.as_ref(), self.model, options, &path, &mut |_| ())?;
        Ok(path)
    }

    fn answer(
        &self,
        localizer: &Localizer,
        pack_path: &Path,
        shot: &Shot,
        photo: &Photo,
        setup: &Setup,
        measured: &mut Measured,
    ) -> Result<(), BenchError> {
        let prior = shot.prior(setup.heading_known);
        let since = Instant::now();
        let mut frame = match self
            .sift_maps
            .get(pack_path)
            .filter(|_| setup.method != Method::Learned)
        {
            None => {
                let (outcome, trace) = localizer.locate_traced(photo, &prior)?;
                for (right, ranks) in [
                    (RightTile::Covers, &mut measured.covers),
                    (RightTile::PAPER, &mut measured.near),
                ] {
                    ranks.push(FrameRecall::of(localizer.pack(), &trace, shot.truth, right));
                }
                measured.distances.push(FrameDistances::of(
                    localizer.pack(),
                    &trace,
                    shot.truth,
                    MOST_RANKS,
                ));
                frame_of(shot, &outcome)
            }
            Some(map) => {
                let among = match setup.method {
                    Method::SiftAmongRetrieved => Some(localizer.retrieve(photo, &prior)?),
                    _ => None,
                };
                match map.locate(photo, &prior, among.as_deref())? {
                    Some(fix) => {
                        Frame::score(&shot.name, &without_covariance(fix.position), shot.truth)
                    }
                    None => Frame::missed(&shot.name, "no transform explains any matches"),
                }
            }
        };
        if setup.method != Method::Learned {
            // The baseline states no radius.
            (frame.radius95_m, frame.mahalanobis2) = (None, None);
        }
        frame.time_ms = Some(since.elapsed().as_secs_f64() * 1e3);
        measured.frames.push(frame);
        Ok(())
    }
}

/// The photo without its picture, to be given another.
fn copy_of(photo: &Photo) -> Photo {
    Photo {
        path: photo.path.clone(),
        image: image::RgbImage::new(0, 0),
        full_size_px: photo.full_size_px,
        metadata: Metadata::clone(&photo.metadata),
    }
}

fn without_covariance(position: grimnet_geo::LonLat) -> ScoredFix {
    ScoredFix {
        position,
        covariance_en_m2: [1.0, 0.0, 1.0],
        radius95_m: 0.0,
    }
}

fn frame_of(shot: &Shot, outcome: &Outcome) -> Frame {
    match outcome {
        Outcome::Fix(fix) => {
            let scored = ScoredFix {
                position: grimnet_geo::LonLat {
                    lon_deg: fix.lon_deg,
                    lat_deg: fix.lat_deg,
                },
                covariance_en_m2: fix.covariance_en_m2,
                radius95_m: fix.radius95_m,
            };
            Frame::score(&shot.name, &scored, shot.truth)
        }
        Outcome::NoFix(no_fix) => Frame::missed(&shot.name, &no_fix.to_string()),
    }
}

/// Build options for one level.
#[must_use]
pub fn at_gsd(build: BuildOptions, gsd_m: f64) -> BuildOptions {
    BuildOptions {
        levels: Levels::Gsd(vec![gsd_m]),
        ..build
    }
}
