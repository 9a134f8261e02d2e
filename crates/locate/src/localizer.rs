//! The localiser: a photo and prior knowledge in, a fix or a reason out.

use std::borrow::Borrow;
use std::path::Path;

use grimnet_net::{Domain, Extractor, Model, Precision, Statistics};
use grimnet_pack::{Mode, Pack};
use grimnet_photo::Photo;
use image::{GrayImage, RgbImage};

use crate::{
    context::Context,
    error::Result,
    frame_features::FrameFeatures,
    frame_motion::{FrameMotion, FramePair, motion_between},
    needed_pixels::NeededPixels,
    options::{Adapt, Options},
    outcome::Outcome,
    paper::procedure::{self, NetworkImage, check_pack},
    pipeline::{
        queries::{extract_queries, query_maker, side_px},
        run::{self, Located},
    },
    prior::{Near, Prior},
    search::{
        candidates::{by_descriptor, distinct_tiles, tiles_near},
        hypotheses::rounds,
        scratch::ScratchPool,
    },
    trace::Trace,
};

/// Localises photos on the map of one pack. It may be used by several threads at once.
#[derive(Debug)]
pub struct Localizer {
    model: Model,
    pack: Pack,
    extractor: Extractor,
    options: Options,
    /// The options with the gates that apply to a calibrated or uncalibrated model.
    applied: Options,
    scratch: ScratchPool,
}

/// Builds a [`Localizer`] with a model or settings other than the default ones. Made by [`Localizer::builder`].
#[derive(Debug, Clone, Default)]
#[must_use]
pub struct LocalizerBuilder {
    model: Option<Model>,
    precision: Option<Precision>,
    options: Options,
}

impl LocalizerBuilder {
    /// The model that the pack was built with; the bundled model if this is not called.
    pub fn model(self, model: Model) -> Self {
        Self {
            model: Some(model),
            ..self
        }
    }

    /// The precision of the network; that of the model if this is not called. Packs of every precision can be used.
    pub fn precision(self, precision: Precision) -> Self {
        Self {
            precision: Some(precision),
            ..self
        }
    }

    /// The settings; [`Options::default`] if this is not called.
    pub fn options(self, options: Options) -> Self {
        Self { options, ..self }
    }

    /// Opens the pack at `path` and builds the localiser.
    ///
    /// # Errors
    /// Returns an error if the pack cannot be opened or was built with another model, the settings want paper mode and it was not built
    /// in it, the model cannot run, or a setting is invalid. A pack of paper mode is searched in default mode too; its tiles have another
    /// size, so that fewer photos get a fix.
    pub fn open(self, path: impl AsRef<Path>) -> Result<Localizer> {
        self.build(Pack::open(path)?)
    }

    /// Builds the localiser for an open pack.
    ///
    /// # Errors
    /// As [`LocalizerBuilder::open`].
    pub fn build(self, pack: Pack) -> Result<Localizer> {
        self.options.check()?;
        let model = match self.model {
            Some(model) => model,
            None => Model::bundled()?,
        };
        let model = model.with_precision_if_given(self.precision)?;
        self.options.check_model(&model)?;
        if self.options.mode == Mode::Paper {
            check_pack(&pack)?;
        }
        Ok(Localizer::new(model, pack)?.with_options(self.options))
    }
}

impl Localizer {
    /// Opens the pack at `path` and makes a localiser with the bundled model and default settings.
    ///
    /// # Errors
    /// Returns an error if the pack cannot be opened or was built with another model, or the model cannot run.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::builder().open(path)
    }

    /// A builder, to choose the model or the settings.
    pub fn builder() -> LocalizerBuilder {
        LocalizerBuilder::default()
    }

    /// A localiser with default settings. `model` must be the model that the pack was built with.
    ///
    /// # Errors
    /// Returns an error if the pack was built with another model, or the model cannot run.
    pub fn new(model: Model, pack: Pack) -> Result<Self> {
        pack.check_model(&model)?;
        let extractor = Extractor::new(&model, Domain::Uav)?;
        let options = Options::default();
        Ok(Self {
            applied: applied_to(&model, &options),
            model,
            pack,
            extractor,
            options,
            scratch: ScratchPool::default(),
        })
    }

    /// The same localiser with other settings. They are checked by [`Localizer::locate`].
    pub fn with_options(self, options: Options) -> Self {
        Self {
            applied: applied_to(&self.model, &options),
            options,
            ..self
        }
    }

    /// The settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The pack.
    pub fn pack(&self) -> &Pack {
        &self.pack
    }

    /// Whether a tile of the pack may show a part of an area: that photos can be found there with [`Prior::near`].
    ///
    /// # Errors
    /// The pack has no coordinates there.
    pub fn has_tiles_near(&self, near: &Near) -> Result<bool> {
        // The coarsest first, which has the fewest.
        let levels = self.pack.levels().iter().rev();
        let mut tiles = levels.flat_map(|level| tiles_near(level, near));
        // The first tile of the area, or the first error.
        tiles
            .find(|allowed| !matches!(allowed, Ok(false)))
            .unwrap_or(Ok(false))
    }

    /// How many pixels of photos, of which `prior` is known, the search can use. Photos that are read by
    /// [`NeededPixels::open`] are decoded faster than at full size, and found as well.
    #[must_use]
    pub fn needed_pixels(&self, prior: &Prior) -> NeededPixels {
        NeededPixels::new(&self.pack, &self.options, &prior.view)
    }

    /// Finds the position of the photo's centre.
    ///
    /// The same photo, prior, pack and settings give the same answer, whatever else is localised and on any number of threads,
    /// unless a time budget is set.
    ///
    /// # Errors
    /// Returns an error if the settings or the prior are invalid, or an input is unusable. A photo whose position is not found is
    /// no error but [`Outcome::NoFix`].
    pub fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Outcome> {
        Ok(self.locate_traced(photo, prior)?.0)
    }

    /// As [`Localizer::locate`], with the steps of the search.
    ///
    /// # Errors
    /// As [`Localizer::locate`].
    #[doc(hidden)]
    pub fn locate_traced(&self, photo: &Photo, prior: &Prior) -> Result<(Outcome, Trace)> {
        let located = self.run(photo, prior)?;
        Ok((located.outcome, located.trace))
    }

    /// As [`Localizer::locate`], with the photo's keypoints and descriptors, from which [`Localizer::motion_between`] measures
    /// the motion to another photo. `None` in paper mode, and for a photo that is damaged or of one brightness.
    ///
    /// # Errors
    /// As [`Localizer::locate`].
    pub fn locate_with_features(
        &self,
        photo: &Photo,
        prior: &Prior,
    ) -> Result<(Outcome, Option<FrameFeatures>)> {
        let located = self.run(photo, prior)?;
        Ok((located.outcome, located.features))
    }

    /// The motion of the camera over level ground from the first photo to the second; `None` if too few keypoints agree on one,
    /// as over water or where the photos do not overlap. Both photos must have been searched under about the true heading, or
    /// under the same one with little turn between them: descriptors tolerate a turn of about 15 degrees.
    ///
    /// The keypoints of `second` that moved with the ground of `first` are marked in it: the ground is followed from photo to photo
    /// where the map does not show it.
    ///
    /// # Errors
    /// The descriptors cannot be compared.
    pub fn motion_between(
        &self,
        first: &FrameFeatures,
        second: &mut FrameFeatures,
        pair: &FramePair,
    ) -> Result<Option<FrameMotion>> {
        self.scratch
            .with(|scratch| motion_between(first, second, pair, self.options.seed, scratch))
    }

    fn run(&self, photo: &Photo, prior: &Prior) -> Result<Located> {
        let context = self.context();
        let budget = context.start_budget();
        self.options.check()?;
        prior.check()?;
        let view = photo.view(&prior.view);
        let mut located = match (photo.damage, self.options.mode) {
            (Some(damage), _) => Located::damaged(damage, &view),
            (None, Mode::Paper) => procedure::locate(context, photo, &view, prior)?,
            (None, Mode::Default) => run::locate(context, photo, &view, prior, budget)?,
        };
        let mut time_ms = located.time_ms;
        time_ms.total = budget.elapsed_ms();
        match &mut located.outcome {
            Outcome::Fix(fix) => fix.time_ms = time_ms,
            Outcome::NoFix(no_fix) => no_fix.time_ms = time_ms,
        }
        Ok(located)
    }

    /// The same localiser with batch-normalisation statistics recomputed from the photos of a flight, without labels
    /// ([`Adapt::Flight`]). Every answer then depends on these photos, which are taken one at a time. Damaged photos are left out.
    ///
    /// # Errors
    /// Returns an error if a photo cannot be resampled, there is none, or the settings want paper mode and the pack was not built in it.
    pub fn adapted_to_flight<'a, P: Borrow<Photo>>(
        self,
        photos: impl IntoIterator<Item = (P, &'a Prior)>,
    ) -> Result<Self> {
        let mut statistics = Vec::new();
        for (photo, prior) in photos {
            let photo = photo.borrow();
            if photo.damage.is_some() {
                continue;
            }
            let Some((picture, mask)) = self.first_picture(photo, prior)? else {
                continue;
            };
            let (_, of_photo) = self.extractor.dense_instance(&picture, mask.as_ref())?;
            statistics.push(of_photo);
        }
        let statistics = Statistics::mean_of(&statistics)?;
        let extractor = Extractor::with_statistics(&self.model, Domain::Uav, &statistics)?;
        let options = Options {
            adapt: Adapt::Flight,
            ..self.options.clone()
        };
        Ok(Self { extractor, ..self }.with_options(options))
    }

    /// The first picture that the network sees of a photo, and its mask if a part is black: the whole photo in paper mode, else a query
    /// for the first hypothesis. `None` for a pack without tiles.
    fn first_picture(
        &self,
        photo: &Photo,
        prior: &Prior,
    ) -> Result<Option<(RgbImage, Option<GrayImage>)>> {
        if self.options.mode == Mode::Paper {
            check_pack(&self.pack)?;
            let seen = self.network_image(photo, prior)?;
            return Ok(Some((seen.rgb, seen.mask)));
        }
        let view = photo.view(&prior.view);
        let Some(hypothesis) = rounds(&view, &self.pack, &self.options)
            .first()
            .and_then(|round| round.hypotheses.first().copied())
        else {
            return Ok(None);
        };
        let maker = query_maker(self.context(), photo, &view, &hypothesis, u32::MAX)?;
        let query = maker.make(0.0);
        Ok(Some((query.image, Some(query.mask))))
    }

    /// The same localiser with photos normalised by the statistics of another domain, to measure what domain-aware batch
    /// normalisation contributes.
    ///
    /// # Errors
    /// Returns an error if the model cannot run.
    #[doc(hidden)]
    pub fn seeing_photos_as(self, domain: Domain) -> Result<Self> {
        let extractor = Extractor::new(&self.model, domain)?;
        Ok(Self { extractor, ..self })
    }

    /// The level of the pack that the photo is compared with first; `None` for a pack without tiles. Packs of paper mode have one.
    #[doc(hidden)]
    #[must_use]
    pub fn first_level(&self, photo: &Photo, prior: &Prior) -> Option<usize> {
        if self.options.mode == Mode::Paper {
            return Some(procedure::LEVEL);
        }
        let rounds = rounds(&photo.view(&prior.view), &self.pack, &self.options);
        Some(rounds.first()?.hypotheses.first()?.level)
    }

    /// The tiles most similar to the photo under its first round of hypotheses (in paper mode to the whole photo), best first, at
    /// most [`Options::top_k`]. They are indices in [`Localizer::first_level`].
    ///
    /// # Errors
    /// As [`Localizer::locate`].
    #[doc(hidden)]
    pub fn retrieve(&self, photo: &Photo, prior: &Prior) -> Result<Vec<usize>> {
        self.options.check()?;
        prior.check()?;
        let context = self.context();
        let view = photo.view(&prior.view);
        if self.options.mode == Mode::Paper {
            return procedure::retrieve(context, photo, &view, prior);
        }
        let Some(round) = rounds(&view, &self.pack, &self.options).into_iter().next() else {
            return Ok(Vec::new());
        };
        let Some(first) = round.hypotheses.first() else {
            return Ok(Vec::new());
        };
        let side_px = side_px(context, &round.hypotheses);
        let wanted = (&round.hypotheses[..], round.purpose);
        let queries = extract_queries(context, photo, &view, wanted, side_px)?.features;
        let mut tiles = distinct_tiles(&by_descriptor(
            context.level(first.level),
            &queries,
            prior.near.as_ref(),
            &self.options,
        )?);
        tiles.truncate(self.options.top_k);
        Ok(tiles)
    }

    /// What the network sees of a photo in paper mode.
    ///
    /// # Errors
    /// The photo cannot be resampled.
    #[doc(hidden)]
    pub fn network_image(&self, photo: &Photo, prior: &Prior) -> Result<NetworkImage> {
        let context = self.context();
        let level = context.level(procedure::LEVEL);
        procedure::network_image(context, photo, &photo.view(&prior.view), level)
    }

    fn context(&self) -> Context<'_> {
        Context {
            model: &self.model,
            pack: &self.pack,
            extractor: &self.extractor,
            options: &self.applied,
            scratch: &self.scratch,
        }
    }
}

/// The options as they apply to `model`.
fn applied_to(model: &Model, options: &Options) -> Options {
    let is_calibrated = model.calibration().confidence.is_some();
    let gates = options.gates.map(|gates| match is_calibrated {
        true => gates.with_calibration(),
        false => gates,
    });
    Options {
        gates,
        ..options.clone()
    }
}
