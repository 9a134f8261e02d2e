//! From the best answer of a search to a fix, or to the reason why there is none.

use grimnet_net::{Calibration, Purpose};
use grimnet_pack::Level;
use grimnet_photo::{Photo, View};

use crate::{
    confidence::{Support, with_unknown_width},
    context::Context,
    error::Result,
    geometry::distribution::{occupied_cells, spread},
    options::Options,
    outcome::{
        EvidenceUsed, Fix, MatchedPoints, NoFix, Outcome, Reason, Rejection, RunnerUp, TileRef,
        TimeMs,
    },
    pipeline::{
        ground_position::{GroundPosition, ground_position, matched_points},
        held_back::HeldBack,
        queries::{extract_queries, side_px},
        ranking::{RankedAnswer, Rival, runner_up_inliers},
        verification::VerifiedCandidate,
    },
    query_features::QueryFeatures,
    search::candidates::Candidate,
};

/// The outcome for the best answer. `evidence` says which metadata were used.
pub(crate) fn outcome(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    best: &RankedAnswer<'_>,
    evidence: EvidenceUsed,
) -> Result<Outcome> {
    let evidence = EvidenceUsed {
        assumed: Some(best.round.assumption.clone()),
        ..evidence
    };
    let level = context.level(best.round.level);
    let query = &best.round.queries[best.verified.candidate.query];
    let drawn = context
        .options
        .keep_matches
        .then(|| Box::new(matched_points(best.verified, level, query, photo)));
    Ok(match accept(context, photo, view, best, level, query)? {
        Ok(accepted) => Outcome::Fix(Box::new(accepted.into_fix(context, best, evidence, drawn))),
        Err(rejection) => Outcome::NoFix(Box::new(NoFix {
            drawn,
            ..no_fix_for(Reason::Rejected(rejection), Some(best.verified), evidence)
        })),
    })
}

/// An answer that passed every gate.
struct AcceptedAnswer {
    position: GroundPosition,
    support: Support,
    confidence: Option<f64>,
}

/// Passes the answer through the gates that need its ground position; returns the first that it does not pass.
fn accept(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    best: &RankedAnswer<'_>,
    level: &Level,
    query: &QueryFeatures,
) -> Result<std::result::Result<AcceptedAnswer, Rejection>> {
    if let Some(rejection) = best.rejection {
        return Ok(Err(rejection));
    }
    let calibration = context.model.calibration();
    let error = &calibration.position;
    let Some(position) =
        ground_position(best.verified, level, query, photo, error, context.options)?
    else {
        return Ok(Err(Rejection::NotFinite));
    };
    if let Some(Err(rejection)) = context
        .options
        .gates
        .map(|gates| gates.check_on_map(position.on_map))
    {
        return Ok(Err(rejection));
    }
    let held_back = held_back(context, photo, view, best)?;
    let support = Support {
        held_back_points: held_back.points,
        held_back_excess: held_back.excess,
        on_map: position.on_map,
        ..support(
            best.verified,
            query,
            position.inlier_covariance_en_m2,
            runner_up_inliers(best.runner_up.map(|rival| rival.verified)),
        )
    };
    let hypothesis = &best.round.hypotheses[best.verified.candidate.query];
    let confidence = confidence(&support, calibration).map(|given| {
        if hypothesis.is_width_searched {
            with_unknown_width(given)
        } else {
            given
        }
    });
    Ok(
        match confidence_rejection(confidence, calibration, context.options) {
            Some(rejection) => Err(rejection),
            None => Ok(AcceptedAnswer {
                position,
                support,
                confidence,
            }),
        },
    )
}

impl AcceptedAnswer {
    fn into_fix(
        self,
        context: Context<'_>,
        best: &RankedAnswer<'_>,
        evidence: EvidenceUsed,
        drawn: Option<Box<MatchedPoints>>,
    ) -> Fix {
        let Self {
            position,
            support,
            confidence,
        } = self;
        let runner_up = best.runner_up.and_then(|Rival { round, verified }| {
            let centre = verified.centre_level_px?;
            let lonlat = context
                .level(round.level)
                .lonlat_from_level_px(centre)
                .ok()?;
            Some(RunnerUp {
                lat_deg: lonlat.lat_deg,
                lon_deg: lonlat.lon_deg,
                inliers: verified.inliers.len(),
            })
        });
        Fix {
            lat_deg: position.centre.lat_deg,
            lon_deg: position.centre.lon_deg,
            heading_deg: Some(position.heading_deg),
            gsd_m: position.gsd_m,
            covariance_en_m2: position.covariance_en_m2,
            radius95_m: position.radius95_m,
            confidence,
            support,
            inliers: support.inliers,
            matches: support.matches,
            tile: tile_ref(
                best.round.level,
                context.level(best.round.level),
                &best.verified.candidate,
            ),
            runner_up,
            outline_lon_lat_deg: position.outline_lon_lat_deg,
            evidence,
            time_ms: TimeMs::default(),
            drawn,
        }
    }
}

/// The probability that a fix with this support is right; `None` if the model is not calibrated.
fn confidence(support: &Support, calibration: &Calibration) -> Option<f64> {
    Some(support.confidence(calibration.confidence.as_ref()?))
}

fn confidence_rejection(
    confidence: Option<f64>,
    calibration: &Calibration,
    options: &Options,
) -> Option<Rejection> {
    let needed = calibration.confidence.as_ref()?.needed;
    options.gates?.check_confidence(confidence?, needed).err()
}

/// The agreement of the photo with the keypoints that the best answer does not rest on.
fn held_back(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    best: &RankedAnswer<'_>,
) -> Result<HeldBack> {
    let level = context.level(best.round.level);
    let number = best.verified.candidate.query;
    if let Some(query) = &best.round.dense {
        return HeldBack::of(query, level, best.verified);
    }
    // The network's output of one of several hypotheses was not kept.
    let side_px = side_px(context, &best.round.hypotheses);
    let hypothesis = best.round.hypotheses[number];
    let wanted = (&[hypothesis][..], Purpose::Answer);
    let again = extract_queries(context, photo, view, wanted, side_px)?;
    again.dense.map_or_else(
        || Ok(HeldBack::default()),
        |query| HeldBack::of(&query, level, best.verified),
    )
}

/// What a fix rests on, but for the share of the photo on the map and the held-back keypoints.
pub(crate) fn support(
    verified: &VerifiedCandidate,
    query: &QueryFeatures,
    inlier_covariance_en_m2: [f64; 3],
    runner_up_inliers: usize,
) -> Support {
    let agreeing = verified.inliers.iter();
    let points = agreeing.map(|&index| verified.pairs[index].from);
    Support {
        inliers: verified.inliers.len(),
        places: occupied_cells(points.clone(), query.half_side_px),
        matches: verified.pairs.len(),
        runner_up_inliers,
        spread: spread(points, query.half_side_px),
        expected_inliers: verified.expected_inliers,
        held_back_points: 0,
        held_back_excess: 0.0,
        on_map: 1.0,
        inlier_covariance_en_m2,
    }
}

/// The candidate's tile as the answer states it.
pub(crate) fn tile_ref(level_index: usize, level: &Level, candidate: &Candidate) -> TileRef {
    TileRef {
        level: level_index,
        gsd_m: level.gsd_m(),
        index: candidate.tile,
        similarity: candidate.similarity,
        votes: candidate.peak.votes,
    }
}

/// The outcome without a fix, for this reason.
pub(crate) fn no_fix(
    reason: Reason,
    best: Option<&VerifiedCandidate>,
    evidence: EvidenceUsed,
) -> Outcome {
    Outcome::NoFix(Box::new(no_fix_for(reason, best, evidence)))
}

fn no_fix_for(reason: Reason, best: Option<&VerifiedCandidate>, evidence: EvidenceUsed) -> NoFix {
    NoFix {
        reason,
        inliers: best.map_or(0, |best| best.inliers.len()),
        matches: best.map_or(0, |best| best.pairs.len()),
        evidence,
        time_ms: TimeMs::default(),
        drawn: None,
    }
}
