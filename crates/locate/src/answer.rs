//! From the best answer of a search to a fix, or to the reason why there is none.

use grimnet_geo::distance_m;
use grimnet_pack::Level;
use grimnet_photo::Photo;

use crate::{
    confidence::Support,
    error::Result,
    gates::{Rejection, occupied_places, spread},
    localizer::Localizer,
    outcome::{
        EvidenceUsed, Fix, MatchedPoints, NoFix, Outcome, Reason, RunnerUp, TileRef, TimeMs,
    },
    place::{Place, matched_points, place},
    prior::Prior,
    query_features::QueryFeatures,
    ranking::{Best, runner_up_inliers},
    verify::Verified,
};

impl Localizer {
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

    /// The answer that `best` gives; `evidence` is what was believed of the photo's metadata.
    pub(crate) fn answer(
        &self,
        photo: &Photo,
        prior: &Prior,
        best: &Best<'_>,
        evidence: EvidenceUsed,
    ) -> Result<Outcome> {
        let evidence = EvidenceUsed {
            assumed: Some(best.tried.about.clone()),
            ..evidence
        };
        let level = &self.pack.levels()[best.tried.level];
        let query = &best.tried.queries[best.verified.candidate.query];
        let drawn = self
            .options
            .keep_matches
            .then(|| Box::new(matched_points(best.verified, level, query, photo)));
        Ok(match self.judge(photo, prior, best, level, query)? {
            Ok(judged) => Outcome::Fix(Box::new(judged.into_fix(best, level, evidence, drawn))),
            Err(rejection) => Outcome::NoFix(Box::new(NoFix {
                drawn,
                ..refusal(Reason::Rejected(rejection), Some(best.verified), evidence)
            })),
        })
    }

    /// What `best` says where the photo was taken, or the gate that refuses it.
    fn judge(
        &self,
        photo: &Photo,
        prior: &Prior,
        best: &Best<'_>,
        level: &Level,
        query: &QueryFeatures,
    ) -> Result<std::result::Result<Judged, Rejection>> {
        if let Some(rejection) = best.rejection {
            return Ok(Err(rejection));
        }
        let error = &self.model.calibration().position;
        let Some(place) = place(best.verified, level, query, photo, error, &self.options)? else {
            return Ok(Err(Rejection::NotFinite));
        };
        if prior
            .near
            .is_some_and(|near| distance_m(near.centre, place.centre) > near.radius_m)
        {
            return Ok(Err(Rejection::OutsideArea));
        }
        let support = support(
            best.verified,
            query,
            place.inlier_covariance_en_m2,
            runner_up_inliers(best.runner_up),
        );
        let confidence = self.confidence(&support);
        Ok(match self.check_confidence(confidence) {
            Some(rejection) => Err(rejection),
            None => Ok(Judged {
                place,
                support,
                confidence,
            }),
        })
    }
}

/// An answer that passed every gate.
struct Judged {
    place: Place,
    support: Support,
    confidence: Option<f64>,
}

impl Judged {
    fn into_fix(
        self,
        best: &Best<'_>,
        level: &Level,
        evidence: EvidenceUsed,
        drawn: Option<Box<MatchedPoints>>,
    ) -> Fix {
        let Self {
            place,
            support,
            confidence,
        } = self;
        let runner_up = best.runner_up.and_then(|other| {
            let lonlat = level
                .lonlat_from_level_px(other.centre_level_px?.into())
                .ok()?;
            Some(RunnerUp {
                lat_deg: lonlat.lat_deg,
                lon_deg: lonlat.lon_deg,
                inliers: other.inliers.len(),
            })
        });
        Fix {
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
            tile: TileRef::of(best.tried.level, level, &best.verified.candidate),
            runner_up,
            outline_lonlat_deg: place.outline_lonlat_deg,
            evidence,
            time_ms: TimeMs::default(),
            drawn,
        }
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

/// No fix, for this reason.
pub(crate) fn no_fix(reason: Reason, best: Option<&Verified>, evidence: EvidenceUsed) -> Outcome {
    Outcome::NoFix(Box::new(refusal(reason, best, evidence)))
}

fn refusal(reason: Reason, best: Option<&Verified>, evidence: EvidenceUsed) -> NoFix {
    NoFix {
        reason,
        inliers: best.map_or(0, |best| best.inliers.len()),
        matches: best.map_or(0, |best| best.pairs.len()),
        evidence,
        time_ms: TimeMs::default(),
        drawn: None,
    }
}
