//! The facade: a photo and what is known of it in, a fix or a reason out.

use std::time::Instant;

use grimnet_net::{Domain, Extractor, Model, Statistics};
use grimnet_pack::Pack;
use grimnet_photo::{Photo, View};

use crate::{
    answer::no_fix,
    attempt::Tried,
    candidates::{Desks, by_descriptor},
    error::Result,
    hypotheses::rounds,
    options::{Adapt, Mode, Options},
    outcome::{EvidenceUsed, Outcome, Reason, TimeMs, elapsed_ms},
    prior::Prior,
    ranking::Best,
    trace::{Trace, tiles_of},
};

/// Localises photos on the map of one pack. May be used from several threads at once.
#[derive(Debug)]
pub struct Localizer {
    pub(crate) model: Model,
    pub(crate) pack: Pack,
    pub(crate) extractor: Extractor,
    pub(crate) options: Options,
    pub(crate) desks: Desks,
}

/// Fewer keypoints than this show nothing that could be recognised.
pub(crate) const MIN_KEYPOINTS: usize = 8;

impl Localizer {
    /// Localises on the map of `pack` with the model that it was built with.
    ///
    /// # Errors
    /// Where the pack was built with another model, or the model cannot run.
    pub fn new(model: Model, pack: Pack) -> Result<Self> {
        pack.check_model(&model)?;
        let extractor = Extractor::new(&model, Domain::Uav)?;
        Ok(Self {
            model,
            pack,
            extractor,
            options: Options::default(),
            desks: Desks::default(),
        })
    }

    /// The same with other settings.
    pub fn with_options(self, options: Options) -> Self {
        Self { options, ..self }
    }

    /// The settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The pack.
    pub fn pack(&self) -> &Pack {
        &self.pack
    }

    /// The same with normalisation statistics taken from the photos of a flight, without labels ([`Adapt::Flight`]). Every answer
    /// then depends on these photos.
    ///
    /// # Errors
    /// Where a photo cannot be resampled, or there is none.
    pub fn adapted_to_flight<'a>(
        self,
        photos: impl IntoIterator<Item = (&'a Photo, &'a Prior)>,
    ) -> Result<Self> {
        let mut all = Vec::new();
        for (photo, prior) in photos {
            let view = photo.view(&prior.overrides());
            let Some(hypothesis) = rounds(&view, prior, &self.pack, &self.options)
                .first()
                .and_then(|round| round.hypotheses.first().copied())
            else {
                continue;
            };
            let query = self
                .query_maker(photo, &view, &hypothesis, u32::MAX)?
                .make(0.0);
            all.push(
                self.extractor
                    .dense_instance(&query.image, Some(&query.mask))?
                    .1,
            );
        }
        let statistics = Statistics::mean_of(&all)?;
        let extractor = Extractor::with_statistics(&self.model, Domain::Uav, &statistics)?;
        let options = Options {
            adapt: Adapt::Flight,
            ..self.options
        };
        Ok(Self {
            extractor,
            options,
            ..self
        })
    }

    /// The same, with photos normalised by another domain's statistics and parameters: what the two sets of DA-BN are worth.
    ///
    /// # Errors
    /// The model cannot run.
    pub fn seeing_photos_as(self, domain: Domain) -> Result<Self> {
        let extractor = Extractor::new(&self.model, domain)?;
        Ok(Self { extractor, ..self })
    }

    /// The tiles most similar to the photo under its first round of hypotheses, best first, [`Options::top_k`] at most: retrieval
    /// alone.
    ///
    /// # Errors
    /// As [`Localizer::locate`].
    pub fn retrieve(&self, photo: &Photo, prior: &Prior) -> Result<Vec<usize>> {
        self.options.check()?;
        prior.check()?;
        let view = photo.view(&prior.overrides());
        let mut time_ms = TimeMs::default();
        let Some(round) = rounds(&view, prior, &self.pack, &self.options)
            .into_iter()
            .next()
        else {
            return Ok(Vec::new());
        };
        let Some(first) = round.hypotheses.first() else {
            return Ok(Vec::new());
        };
        let level = &self.pack.levels()[first.level];
        let side = self.side_px(&round.hypotheses);
        let queries = self.queries(photo, &view, &round.hypotheses, side, &mut time_ms)?;
        let mut tiles = tiles_of(&by_descriptor(
            level,
            &queries,
            prior.near.as_ref(),
            &self.options,
        )?);
        tiles.truncate(self.options.top_k);
        Ok(tiles)
    }

    /// Finds where the photo's centre lies.
    ///
    /// The same photo, prior, pack and settings give the same answer, whatever else is localised and on however many threads,
    /// unless a time budget is set.
    ///
    /// # Errors
    /// Where options mean nothing, or photo, network or pack refuse. Not finding the place is no error.
    pub fn locate(&self, photo: &Photo, prior: &Prior) -> Result<Outcome> {
        Ok(self.locate_traced(photo, prior)?.0)
    }

    /// The same, with what was tried on the way.
    ///
    /// # Errors
    /// As [`Localizer::locate`].
    pub fn locate_traced(&self, photo: &Photo, prior: &Prior) -> Result<(Outcome, Trace)> {
        let start = Instant::now();
        self.options.check()?;
        prior.check()?;
        let mut time_ms = TimeMs::default();
        let view = photo.view(&prior.overrides());
        let (mut outcome, trace) = match self.options.mode {
            Mode::Paper => self.locate_as_paper(photo, &view, prior, &mut time_ms)?,
            Mode::Default => self.locate_by_rounds(photo, &view, prior, start, &mut time_ms)?,
        };
        time_ms.total = elapsed_ms(start);
        match &mut outcome {
            Outcome::Fix(fix) => fix.time_ms = time_ms,
            Outcome::NoFix(no_fix) => no_fix.time_ms = time_ms,
        }
        Ok((outcome, trace))
    }

    fn locate_by_rounds(
        &self,
        photo: &Photo,
        view: &View,
        prior: &Prior,
        start: Instant,
        time_ms: &mut TimeMs,
    ) -> Result<(Outcome, Trace)> {
        let mut rounds_tried: Vec<Tried> = Vec::new();
        let mut most_keypoints = 0;
        for round in rounds(view, prior, &self.pack, &self.options) {
            let tried = self.try_round(photo, view, prior, &round, start, time_ms)?;
            most_keypoints = tried
                .queries
                .iter()
                .map(|query| query.points.len())
                .max()
                .unwrap_or(0)
                .max(most_keypoints);
            let clear =
                Best::of(&tried, &self.options).is_some_and(|best| best.is_clear(&self.options));
            rounds_tried.push(tried);
            if clear || self.is_over_budget(start) {
                break;
            }
        }
        let trace = Trace {
            rounds: rounds_tried
                .iter()
                .map(|tried| tried.trace.clone())
                .collect(),
        };
        let evidence = EvidenceUsed::of(view);
        let best = rounds_tried
            .iter()
            .filter_map(|tried| Best::of(tried, &self.options))
            .reduce(|a, b| if b.rank() > a.rank() { b } else { a });
        let Some(best) = best else {
            let reason = if most_keypoints < MIN_KEYPOINTS {
                Reason::TooFewKeypoints {
                    found: most_keypoints,
                }
            } else {
                Reason::NoTiles
            };
            return Ok((no_fix(reason, None, evidence), trace));
        };
        let realigned = self.realign(photo, view, &best, time_ms)?;
        let again = realigned
            .as_ref()
            .and_then(|tried| Best::of(tried, &self.options));
        let best = best.or_again(again, &self.options);
        let outcome = self.answer(photo, prior, &best, evidence)?;
        Ok((outcome, trace))
    }

    pub(crate) fn is_over_budget(&self, start: Instant) -> bool {
        self.options
            .budget_ms
            .is_some_and(|budget_ms| elapsed_ms(start) >= budget_ms)
    }
}
