//! The facade: a photo and what is known of it in, a fix or a reason out.

use std::time::Instant;

use grimnet_geo::distance_m;
use grimnet_net::{Domain, Extractor, Model, Statistics};
use grimnet_pack::{Level, Pack};
use grimnet_photo::{Photo, QueryMaker, QueryOptions, View};
use nalgebra::Vector2;
use rayon::prelude::*;

use crate::{
    answer::{matched_points, place},
    candidates::{Candidate, Desks, by_descriptor},
    cascade::Cascade,
    confidence::Support,
    error::{LocateError, Result},
    gates::{Rejection, occupied_places, spread},
    hypotheses::{Hypothesis, Round, rounds},
    options::{Adapt, Mode, Options},
    outcome::{EvidenceUsed, Fix, NoFix, Outcome, Reason, RunnerUp, TileRef, TimeMs},
    prior::Prior,
    query_features::QueryFeatures,
    solve::Expected,
    trace::{RoundTrace, Trace, tiles_of},
    verify::{Verified, level_px_per_query_px, verify},
    vote::Peak,
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
const MIN_KEYPOINTS: usize = 8;
/// Candidates matched side by side. A constant, so that the answer does not depend on the number of threads.
const BATCH: usize = 4;
/// Two answers closer than this are of the same place, pixels of the level.
const SAME_PLACE_PX: f64 = 32.0;
/// Turned by more than this, or scaled by more than [`REALIGN_SCALE`], a photo is matched again as the first answer says.
const REALIGN_DEG: f64 = 5.0;
/// See [`REALIGN_DEG`].
const REALIGN_SCALE: f64 = 0.06;

/// A round's hypotheses with their queries, and what matching made of them.
pub(crate) struct Tried {
    pub level: usize,
    pub hypotheses: Vec<Hypothesis>,
    pub queries: Vec<QueryFeatures>,
    pub verified: Vec<Verified>,
    pub about: String,
    pub trace: RoundTrace,
}

/// The best answer of one round.
struct Best<'a> {
    tried: &'a Tried,
    verified: &'a Verified,
    runner_up: Option<&'a Verified>,
    rejection: Option<Rejection>,
}

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
                .query_maker(photo, &view, &hypothesis, self.pack.levels(), u32::MAX)?
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
        self.check(prior)?;
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
        let queries = self.queries(photo, &view, &round.hypotheses, u32::MAX, &mut time_ms)?;
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
        self.check(prior)?;
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

    fn check(&self, prior: &Prior) -> Result<()> {
        let bad = |name, value: String, expected| {
            Err(LocateError::BadOption {
                name,
                value,
                expected,
            })
        };
        if let Some(near) = &prior.near
            && !(near.centre.is_valid() && near.radius_m > 0.0)
        {
            return bad(
                "near",
                format!("{near:?}"),
                "a place in degrees and a radius in metres above zero",
            );
        }
        let options = &self.options;
        if !(options.query_width_px.is_finite() && options.query_width_px >= 32.0) {
            return bad(
                "query_width_px",
                options.query_width_px.to_string(),
                "must be at least 32",
            );
        }
        if !(options.ransac.threshold_px > 0.0 && options.ransac.threshold_px.is_finite()) {
            return bad(
                "ransac.threshold_px",
                options.ransac.threshold_px.to_string(),
                "must be a number above zero",
            );
        }
        let side_px = options.hypothesis_side_px.min(options.query_side_px);
        if side_px < 32 {
            return bad(
                "hypothesis_side_px or query_side_px",
                side_px.to_string(),
                "must be at least 32",
            );
        }
        if options.top_k == 0 || options.max_matched == 0 {
            return bad("top_k or max_matched", "0".into(), "must be at least 1");
        }
        if options
            .vote
            .is_some_and(|vote| !(vote.bin_px >= 1.0 && vote.bin_px.is_finite()))
        {
            return bad(
                "vote.bin_px",
                format!("{:?}", options.vote.map(|vote| vote.bin_px)),
                "must be at least 1",
            );
        }
        Ok(())
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
            let clear = self
                .best_of(&tried)
                .is_some_and(|best| self.is_clear(&best));
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
        let found_of = |best: &Best<'_>| (best.rejection.is_none(), best.verified.inliers.len());
        let best = rounds_tried
            .iter()
            .filter_map(|tried| self.best_of(tried))
            .reduce(|a, b| if found_of(&b) > found_of(&a) { b } else { a });
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
        let outcome = self.answer(photo, prior, &best, realigned.as_ref(), evidence)?;
        Ok((outcome, trace))
    }

    /// Queries, candidates and full matching of one round.
    fn try_round(
        &self,
        photo: &Photo,
        view: &View,
        prior: &Prior,
        round: &Round,
        start: Instant,
        time_ms: &mut TimeMs,
    ) -> Result<Tried> {
        let hypotheses = round.hypotheses.clone();
        let level_index = hypotheses.first().map_or(0, |hypothesis| hypothesis.level);
        let level = &self.pack.levels()[level_index];
        let side = if hypotheses.len() > 1 {
            self.options.hypothesis_side_px
        } else {
            self.options.query_side_px
        };
        let queries = self.queries(photo, view, &hypotheses, side, time_ms)?;
        let enough = queries
            .iter()
            .any(|query| query.points.len() >= MIN_KEYPOINTS);
        let mut verified = Vec::new();
        let mut trace = RoundTrace {
            level: level_index,
            ..RoundTrace::default()
        };
        if enough {
            let since = Instant::now();
            let candidates = by_descriptor(level, &queries, prior.near.as_ref(), &self.options)?;
            time_ms.search += elapsed_ms(since);
            trace.by_descriptor = tiles_of(&candidates);
            let since = Instant::now();
            let mut cascade = Cascade::new(level, &queries, candidates, &self.desks, &self.options);
            loop {
                let batch = cascade.next_batch(BATCH)?;
                if batch.is_empty() {
                    break;
                }
                let more: Vec<Verified> = batch
                    .par_iter()
                    .map(|candidate| self.verify(level, &hypotheses, &queries, *candidate))
                    .collect::<Result<_>>()?;
                verified.extend(more);
                let enough = verified.len() >= self.options.min_matched;
                if enough
                    && (self.is_over_budget(start)
                        || best_among(&verified, &self.options)
                            .is_some_and(|(best, runner_up)| self.is_clear_among(best, runner_up)))
                {
                    break;
                }
            }
            time_ms.vote += cascade.vote_ms;
            time_ms.matching += elapsed_ms(since) - cascade.vote_ms;
            let matched: Vec<Candidate> = verified.iter().map(|v| v.candidate).collect();
            trace.matched = tiles_of(&matched);
            let rest: Vec<Candidate> = cascade.into_rest().collect();
            trace.by_vote = tiles_of(matched.iter().chain(&rest));
        }
        Ok(Tried {
            level: level_index,
            hypotheses,
            queries,
            verified,
            about: round.about.clone(),
            trace,
        })
    }

    fn verify(
        &self,
        level: &Level,
        hypotheses: &[Hypothesis],
        queries: &[QueryFeatures],
        candidate: Candidate,
    ) -> Result<Verified> {
        let expected = Expected {
            max_rotation_rad: hypotheses[candidate.query].heading_reach_deg.to_radians(),
        };
        let query = &queries[candidate.query];
        self.desks
            .with(|desk| verify(level, query, candidate, expected, desk, &self.options))
    }

    fn queries(
        &self,
        photo: &Photo,
        view: &View,
        hypotheses: &[Hypothesis],
        max_side_px: u32,
        time_ms: &mut TimeMs,
    ) -> Result<Vec<QueryFeatures>> {
        let Some(first) = hypotheses.first() else {
            return Ok(Vec::new());
        };
        let since = Instant::now();
        let maker = self.query_maker(photo, view, first, self.pack.levels(), max_side_px)?;
        let level = &self.pack.levels()[first.level];
        let up_bearing_deg = level
            .georeference()
            .up_bearing_deg(level.georeference().center_px())?;
        let made: Vec<_> = hypotheses
            .par_iter()
            .map(|hypothesis| maker.make(hypothesis.heading_deg - up_bearing_deg))
            .collect();
        time_ms.query += elapsed_ms(since);
        let since = Instant::now();
        let features = made
            .par_iter()
            .map(|query| {
                QueryFeatures::extract(
                    &self.extractor,
                    &query.image,
                    Some(&query.mask),
                    query.photo_px_from_query_px,
                    &self.options,
                )
            })
            .collect();
        time_ms.features += elapsed_ms(since);
        features
    }

    fn query_maker(
        &self,
        photo: &Photo,
        view: &View,
        hypothesis: &Hypothesis,
        levels: &[Level],
        max_side_px: u32,
    ) -> Result<QueryMaker> {
        let level = &levels[hypothesis.level];
        let gsd_m = level.gsd_m() * level_px_per_query_px(level);
        let options = QueryOptions {
            tilt: view.tilt,
            ..QueryOptions::new(gsd_m, hypothesis.width_m)
        };
        let options = QueryOptions {
            max_side_px: options.max_side_px.min(max_side_px),
            ..options
        };
        Ok(photo.query_maker(&options)?)
    }

    /// Matches the best answer again with the photo turned and scaled as it says, and seen in full.
    fn realign(
        &self,
        photo: &Photo,
        view: &View,
        best: &Best<'_>,
        time_ms: &mut TimeMs,
    ) -> Result<Option<Tried>> {
        let query_index = best.verified.candidate.query;
        let (hypothesis, query) = (
            best.tried.hypotheses[query_index],
            &best.tried.queries[query_index],
        );
        let Some(jacobian) = best
            .verified
            .transform
            .as_ref()
            .and_then(|transform| transform.point_jacobian(query.centre))
        else {
            return Ok(None);
        };
        let turned: Vector2<f64> = jacobian * Vector2::new(1.0, 0.0);
        let turn_deg = turned.y.atan2(turned.x).to_degrees();
        let scale = jacobian.determinant().abs().sqrt();
        let cropped = best.tried.hypotheses.len() > 1;
        let worth = cropped || turn_deg.abs() > REALIGN_DEG || (scale - 1.0).abs() > REALIGN_SCALE;
        if !self.options.realign || !worth || !best.verified.rejection.is_none_or(is_support) {
            return Ok(None);
        }
        let hypothesis = Hypothesis {
            width_m: hypothesis.width_m * scale,
            heading_deg: (hypothesis.heading_deg + turn_deg).rem_euclid(360.0),
            heading_reach_deg: 2.0 * REALIGN_DEG,
            ..hypothesis
        };
        let side = self.options.query_side_px;
        let queries = self.queries(photo, view, &[hypothesis], side, time_ms)?;
        let since = Instant::now();
        let level = &self.pack.levels()[best.tried.level];
        let tiles = self.tiles_around(level, best.verified);
        let verified = tiles
            .par_iter()
            .map(|&tile| {
                let candidate = Candidate {
                    query: 0,
                    tile,
                    similarity: best.verified.candidate.similarity,
                    peak: Peak {
                        ..best.verified.candidate.peak
                    },
                };
                self.verify(level, &[hypothesis], &queries, candidate)
            })
            .collect::<Result<_>>()?;
        time_ms.matching += elapsed_ms(since);
        Ok(Some(Tried {
            level: best.tried.level,
            hypotheses: vec![hypothesis],
            queries,
            verified,
            about: best.tried.about.clone(),
            trace: RoundTrace::default(),
        }))
    }

    /// The tile of an answer, and the one whose centre is nearest to the answer's.
    fn tiles_around(&self, level: &Level, verified: &Verified) -> Vec<usize> {
        let tile = level.tile(verified.candidate.tile);
        let mut tiles = vec![verified.candidate.tile];
        if let Some(centre) = verified.centre_level_px {
            let stride = f64::from(level.manifest().stride_px);
            let step = |axis: usize| {
                (f64::from(tile.grid[axis])
                    + ((centre[axis] - tile.center_px[axis]) / stride).round())
                .max(0.0) as u32
            };
            tiles.extend(
                level
                    .tile_at([step(0), step(1)])
                    .filter(|&nearest| nearest != verified.candidate.tile),
            );
        }
        tiles
    }

    fn best_of<'a>(&self, tried: &'a Tried) -> Option<Best<'a>> {
        let (verified, runner_up) = best_among(&tried.verified, &self.options)?;
        let margin = || {
            self.options.gates.and_then(|gates| {
                gates
                    .check_margin(
                        verified.inliers.len(),
                        runner_up.map_or(0, |other| other.inliers.len()),
                    )
                    .err()
            })
        };
        Some(Best {
            tried,
            verified,
            runner_up,
            rejection: verified.rejection.or_else(margin),
        })
    }

    /// The probability that a fix with this support is right, where the model is calibrated.
    pub(crate) fn confidence(&self, support: &Support) -> Option<f64> {
        let model = self.model.calibration().confidence.as_ref()?;
        Some(support.confidence(model))
    }

    fn check_confidence(&self, confidence: Option<f64>) -> Option<Rejection> {
        let needed = self.model.calibration().confidence.as_ref()?.needed;
        self.options
            .gates?
            .check_confidence(confidence?, needed)
            .err()
    }

    fn is_clear(&self, best: &Best<'_>) -> bool {
        self.is_clear_among(best.verified, best.runner_up)
    }

    fn is_clear_among(&self, best: &Verified, runner_up: Option<&Verified>) -> bool {
        // Twice the runner-up: more candidates may follow that are better than any so far.
        best.rejection.is_none()
            && best.inliers.len() >= self.options.clear_inliers
            && best.inliers.len() >= 2 * runner_up.map_or(0, |other| other.inliers.len())
    }

    fn is_over_budget(&self, start: Instant) -> bool {
        self.options
            .budget_ms
            .is_some_and(|budget_ms| elapsed_ms(start) >= budget_ms)
    }

    fn answer(
        &self,
        photo: &Photo,
        prior: &Prior,
        first: &Best<'_>,
        realigned: Option<&Tried>,
        mut evidence: EvidenceUsed,
    ) -> Result<Outcome> {
        evidence.assumed = Some(first.tried.about.clone());
        // The realigned answer replaces the first where it holds; the runner-up is the first's.
        let again = realigned.and_then(|tried| self.best_of(tried));
        let again = again.filter(|again| {
            again.verified.rejection.is_none() && same_place(again.verified, first.verified)
        });
        let mut best = first;
        let mut rejection = first.rejection;
        if let Some(again) = &again
            && (again.verified.inliers.len() >= first.verified.inliers.len()
                || first.rejection.is_some())
        {
            let runner_up = first.runner_up.map_or(0, |other| other.inliers.len());
            let margin = self.options.gates.and_then(|gates| {
                gates
                    .check_margin(again.verified.inliers.len(), runner_up)
                    .err()
            });
            if margin.is_none() || first.rejection.is_some() {
                (best, rejection) = (again, margin);
            }
        }
        let level = &self.pack.levels()[best.tried.level];
        let query = &best.tried.queries[best.verified.candidate.query];
        let drawn = self
            .options
            .keep_matches
            .then(|| Box::new(matched_points(best.verified, level, query, photo)));
        let refuse = |rejection, evidence, drawn| {
            let mut outcome = no_fix(Reason::Rejected(rejection), Some(best.verified), evidence);
            if let Outcome::NoFix(no_fix) = &mut outcome {
                no_fix.drawn = drawn;
            }
            Ok(outcome)
        };
        if let Some(rejection) = rejection {
            return refuse(rejection, evidence, drawn);
        }
        let error = &self.model.calibration().position;
        let Some(place) = place(best.verified, level, query, photo, error, &self.options)? else {
            return refuse(Rejection::NotFinite, evidence, drawn);
        };
        if prior
            .near
            .is_some_and(|near| distance_m(near.centre, place.centre) > near.radius_m)
        {
            return refuse(Rejection::OutsideArea, evidence, drawn);
        }
        let runner_up_inliers = first.runner_up.map_or(0, |other| other.inliers.len());
        let support = support(
            best.verified,
            query,
            place.inlier_covariance_en_m2,
            runner_up_inliers,
        );
        let confidence = self.confidence(&support);
        if let Some(rejection) = self.check_confidence(confidence) {
            return refuse(rejection, evidence, drawn);
        }
        let first_level = &self.pack.levels()[first.tried.level];
        let runner_up = first.runner_up.and_then(|other| {
            let lonlat = first_level
                .lonlat_from_level_px(other.centre_level_px?)
                .ok()?;
            Some(RunnerUp {
                lat_deg: lonlat.lat_deg,
                lon_deg: lonlat.lon_deg,
                inliers: other.inliers.len(),
            })
        });
        let candidate = best.verified.candidate;
        Ok(Outcome::Fix(Box::new(Fix {
            lat_deg: place.centre.lat_deg,
            lon_deg: place.centre.lon_deg,
            heading_deg: place.heading_deg,
            gsd_m: place.gsd_m,
            covariance_en_m2: place.covariance_en_m2,
            radius95_m: place.radius95_m,
            confidence,
            support,
            inliers: support.inliers,
            matches: support.matches,
            tile: TileRef {
                level: best.tried.level,
                gsd_m: level.gsd_m(),
                index: candidate.tile,
                similarity: candidate.similarity,
                votes: candidate.peak.votes,
            },
            runner_up,
            outline_lonlat_deg: place.outline_lonlat_deg,
            evidence,
            time_ms: TimeMs::default(),
            drawn,
        })))
    }
}

/// What a fix rests on.
pub(crate) fn support(
    verified: &Verified,
    query: &QueryFeatures,
    inlier_covariance_en_m2: [f64; 3],
    runner_up_inliers: usize,
) -> Support {
    let agreeing = verified.inliers.iter();
    let points = agreeing.map(|&index| verified.pairs[index].from);
    Support {
        inliers: verified.inliers.len(),
        places: occupied_places(points.clone(), query.half_side_px),
        matches: verified.pairs.len(),
        runner_up_inliers,
        spread: spread(points, query.half_side_px),
        inlier_covariance_en_m2,
    }
}

/// A gate that more matches could open.
fn is_support(rejection: Rejection) -> bool {
    matches!(
        rejection,
        Rejection::Inliers { .. }
            | Rejection::InlierShare { .. }
            | Rejection::Places { .. }
            | Rejection::Spread { .. }
    )
}

/// The best answer and the best at another place. Answers that pass the gates come first.
pub(crate) fn best_among<'a>(
    verified: &'a [Verified],
    options: &Options,
) -> Option<(&'a Verified, Option<&'a Verified>)> {
    use crate::options::Choice;
    let rank = |verified: &Verified| {
        let inliers = verified.inliers.len() as f64;
        let worth = match options.choice {
            Choice::Inliers => inliers,
            Choice::InlierRatio => inliers / (verified.pairs.len() as f64 + 1.0),
        };
        (verified.rejection.is_none(), worth)
    };
    // Of equals the first, which the vote prefers.
    let best = verified
        .iter()
        .reduce(|a, b| if rank(b) > rank(a) { b } else { a })?;
    let others = verified.iter().filter(|other| !same_place(other, best));
    let runner_up = others.reduce(|a, b| {
        if b.inliers.len() > a.inliers.len() {
            b
        } else {
            a
        }
    });
    Some((best, runner_up))
}

fn same_place(a: &Verified, b: &Verified) -> bool {
    match (a.centre_level_px, b.centre_level_px) {
        (Some(a), Some(b)) => (Vector2::from(a) - Vector2::from(b)).norm() <= SAME_PLACE_PX,
        _ => std::ptr::eq(a, b),
    }
}

pub(crate) fn no_fix(reason: Reason, best: Option<&Verified>, evidence: EvidenceUsed) -> Outcome {
    Outcome::NoFix(Box::new(NoFix {
        reason,
        inliers: best.map_or(0, |best| best.inliers.len()),
        matches: best.map_or(0, |best| best.pairs.len()),
        evidence,
        time_ms: TimeMs::default(),
        drawn: None,
    }))
}

pub(crate) fn elapsed_ms(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
