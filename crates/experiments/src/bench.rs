//! Runs ways of localising over scenes, and caches what was measured.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use grimnet_eval::evaluation::{Found, Method, MethodError, TrialError, evaluate};
use grimnet_eval::metrics::Frame;
use grimnet_eval::metrics::rank_distance::FrameDistances;
use grimnet_eval::metrics::recall::{FrameRecall, MOST_RANKS, RightTile};
use grimnet_eval::report::plot::PlotError;
use grimnet_eval::scene::{HeadingMode, Scene};
use grimnet_geo::{GeoError, Raster};
use grimnet_locate::{Localizer, LocateError, Options, Outcome, Prior};
use grimnet_net::{Domain, Model};
use grimnet_output::{OutputError, OutputPolicy};
use grimnet_pack::{BuildOptions, Levels, Pack, PackError, build};
use grimnet_photo::{Photo, PhotoError};

use crate::changed::{Change, Changed};
use crate::given::Given;
use crate::photometry::Photometry;
use crate::sift_method::{SiftMaps, SiftMethodError};

/// What localises the photos.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Localisation {
    /// Retrieval and matching by the network.
    #[default]
    Learned,
    /// SIFT against every tile of the map.
    SiftWholeMap,
    /// SIFT against the tiles that the network retrieved (the paper's G + S).
    SiftAmongRetrieved,
}

/// One way of localising photos.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Setup {
    /// What localises the photos.
    pub method: Localisation,
    /// How the pack is built.
    pub build: BuildOptions,
    /// How photos are localised.
    pub options: Options,
    /// Change of the photos before they are localised.
    pub photometry: Photometry,
    /// Domain whose normalisation statistics are used for photos instead of their own.
    pub photos_as: Option<Domain>,
    /// What the method is given beside the pixels.
    pub given: Given,
}

/// What was measured with one setup on one scene.
#[derive(Debug, Clone, Default)]
pub struct Measured {
    /// Photo by photo.
    pub frames: Vec<Frame>,
    /// Ranks of the first tile that covers the truth; empty for setups without a search.
    pub covers: Vec<FrameRecall>,
    /// Ranks of the first tile whose centre lies within the paper's radius of the truth.
    pub near: Vec<FrameRecall>,
    /// Distances of the first tiles; empty for setups without a search.
    pub distances: Vec<FrameDistances>,
}

/// Why a setup cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// The pack.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The localiser.
    #[error(transparent)]
    Locate(#[from] LocateError),
    /// The SIFT baseline.
    #[error(transparent)]
    Sift(#[from] SiftMethodError),
    /// The map.
    #[error(transparent)]
    Map(#[from] GeoError),
    /// A photo.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// A photo was refused.
    #[error(transparent)]
    Trial(#[from] TrialError),
    /// The folder for packs.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A pack may not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A figure cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}

/// Runs setups over scenes.
pub struct Bench<'a> {
    model: &'a Model,
    folder: PathBuf,
    measured: HashMap<String, Measured>,
    sift_maps: SiftMaps,
}

impl<'a> Bench<'a> {
    /// A bench for one model; packs are kept in `folder`.
    ///
    /// # Errors
    /// The folder cannot be created.
    pub fn new(model: &'a Model, folder: &Path) -> Result<Self, BenchError> {
        fs_err::create_dir_all(folder)?;
        Ok(Self {
            model,
            folder: folder.to_owned(),
            measured: HashMap::new(),
            sift_maps: SiftMaps::default(),
        })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &'a Model {
        self.model
    }

    /// Localises all photos of a scene; a setup that was measured before is not measured again. Scenes are distinguished by name.
    ///
    /// # Errors
    /// The pack cannot be built, or the localiser refuses its options or a photo.
    pub fn measure(&mut self, scene: &Scene, setup: &Setup) -> Result<Measured, BenchError> {
        let key = format!("{} {setup:?}", scene.name);
        if let Some(measured) = self.measured.get(&key) {
            return Ok(measured.clone());
        }
        tracing::info!("{}: {:?}, {:?}", scene.name, setup.method, setup.photometry);
        let pack_path = self.pack(scene, &setup.build)?;
        let mut localizer = Localizer::new(self.model.clone(), Pack::open(&pack_path)?)?
            .with_options(setup.options.clone());
        if let Some(domain) = setup.photos_as {
            localizer = localizer.seeing_photos_as(domain)?;
        }
        let measured = if setup.method == Localisation::Learned {
            run(&localizer, localizer.pack(), scene, setup)?
        } else {
            let among_retrieved = setup.method == Localisation::SiftAmongRetrieved;
            let given = (heading_mode(setup), change(setup));
            let sift = self
                .sift_maps
                .method(&localizer, scene, given, among_retrieved)?;
            run(&sift, localizer.pack(), scene, setup)?
        };
        self.measured.insert(key, measured.clone());
        Ok(measured)
    }

    /// Localises all photos of a scene by two independent networks (the paper's G + M): that of `retrieval` finds `k` tiles, and
    /// this bench's matches in each; the fix with the most inliers is the answer.
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
        let apart = Apart {
            finder: &finder,
            matcher: &matcher,
        };
        let mut measured = run(&apart, finder.pack(), scene, setup)?;
        // The search is not the matcher's.
        measured.covers.clear();
        measured.near.clear();
        measured.distances.clear();
        Ok(measured)
    }

    fn pack(&self, scene: &Scene, options: &BuildOptions) -> Result<PathBuf, BenchError> {
        pack_of(scene.map.as_ref(), self.model, options, &self.folder)
    }
}

/// Builds the pack of a map in `folder`, or finds the one that was built there before.
///
/// # Errors
/// The map cannot be read, the pack cannot be built, or a file of its name is no pack.
pub fn pack_of(
    map: &dyn Raster,
    model: &Model,
    options: &BuildOptions,
    folder: &Path,
) -> Result<PathBuf, BenchError> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&map.content_hash()?);
    hasher.update(format!("{options:?}").as_bytes());
    hasher.update(model.hash().as_bytes());
    let path = folder.join(format!("{}.grim", &hasher.finalize().to_hex()[..16]));
    OutputPolicy::new().check_file(&path, &[&grimnet_pack::format::MAGIC])?;
    build(map, model, options, &path, &mut |_| ())?;
    Ok(path)
}

/// What a setup gives of the heading.
fn heading_mode(setup: &Setup) -> HeadingMode {
    match setup.given {
        Given::Heading | Given::HeadingAndScale => HeadingMode::Known,
        Given::Nothing | Given::Scale => HeadingMode::Unknown,
    }
}

/// What a setup changes of photos and gives of them.
fn change(setup: &Setup) -> Change {
    Change {
        photometry: setup.photometry,
        given: setup.given,
    }
}

/// Runs a method over the photos of a scene.
fn run(
    method: &dyn Method,
    pack: &Pack,
    scene: &Scene,
    setup: &Setup,
) -> Result<Measured, BenchError> {
    let changed = Changed {
        method,
        change: change(setup),
    };
    let trials = evaluate(&changed, &scene.shots, heading_mode(setup), &mut |_| ());
    let mut measured = Measured::default();
    let is_traced = trials.iter().any(|trial| {
        trial
            .found
            .as_ref()
            .is_ok_and(|found| found.trace.is_some())
    });
    for (shot, trial) in scene.shots.iter().zip(trials) {
        let found = match trial.found {
            Ok(found) => found,
            Err(error) => {
                tracing::warn!(photo = shot.name, "counted as a miss: {error}");
                if is_traced {
                    // Nothing was retrieved.
                    measured.covers.push(FrameRecall::default());
                    measured.near.push(FrameRecall::default());
                    measured.distances.push(FrameDistances::default());
                }
                measured.frames.push(trial.frame);
                continue;
            }
        };
        if let Some(trace) = &found.trace {
            let truth = shot.truth.position;
            for (right, ranks) in [
                (RightTile::Covers, &mut measured.covers),
                (RightTile::PAPER, &mut measured.near),
            ] {
                ranks.push(FrameRecall::of(pack, trace, truth, right));
            }
            measured
                .distances
                .push(FrameDistances::of(pack, trace, truth, MOST_RANKS));
        }
        let mut frame = trial.frame;
        if found.outcome.is_none() {
            // The baseline states no uncertainty.
            (frame.radius95_m, frame.mahalanobis2) = (None, None);
        }
        measured.frames.push(frame);
    }
    Ok(measured)
}

/// One localiser retrieves tiles, another matches in each.
struct Apart<'a> {
    finder: &'a Localizer,
    matcher: &'a Localizer,
}

impl Method for Apart<'_> {
    fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Found, MethodError> {
        let first_level = self.finder.first_level(photo, prior).unwrap_or_default();
        let level = &self.finder.pack().levels()[first_level];
        let reach_m = level.tile_m() * std::f64::consts::FRAC_1_SQRT_2;
        let mut best: Option<(usize, Outcome)> = None;
        for tile in self.finder.retrieve(photo, prior)? {
            let centre = level.lonlat_from_level_px(level.tile(tile).centre_px)?;
            let outcome = self.matcher.locate(photo, &prior.near(centre, reach_m))?;
            let inliers = outcome.fix().map_or(0, |fix| fix.inliers);
            if best.as_ref().is_none_or(|(most, _)| inliers > *most) {
                best = Some((inliers, outcome));
            }
        }
        let mut found = match best {
            Some((_, outcome)) => Found::of(outcome, Default::default()),
            None => Found {
                reason: Some("no tile was retrieved".to_owned()),
                ..Found::default()
            },
        };
        // The time of the whole search counts, not of its best tile.
        found.stage_ms.clear();
        Ok(found)
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
