//! The whole search in default mode: round after round until an answer is clear, then a second matching of the best answers.

use grimnet_photo::{Damage, Photo, View};
use nalgebra::Point2;

use crate::{
    context::{Context, TimeBudget},
    error::Result,
    frame_features::FrameFeatures,
    outcome::{EvidenceUsed, Outcome, Reason, TimeMs},
    pipeline::{
        answer::{no_fix, outcome},
        finalists::{self, best_finalist, finalists, realign_all},
        round_result::RoundResult,
        rounds::{Depth, OpenRound},
        verification::VerifiedCandidate,
    },
    prior::Prior,
    query_features::{MIN_KEYPOINTS, QueryFeatures},
    search::hypotheses::rounds,
    trace::Trace,
};

/// An outcome with the steps of its search and the wall time of its stages.
#[derive(Debug)]
pub(crate) struct Located {
    pub outcome: Outcome,
    /// Features of the query that gave the answer, or of the first one.
    pub features: Option<FrameFeatures>,
    pub trace: Trace,
    pub time_ms: TimeMs,
}

impl Located {
    /// The answer for a damaged photo: parts of it may be shifted, which a homography can fit with many inliers.
    pub(crate) fn damaged(damage: Damage, view: &View) -> Self {
        let reason = Reason::DamagedPhoto { damage };
        Self {
            outcome: no_fix(reason, None, EvidenceUsed::of(view)),
            features: None,
            trace: Trace::default(),
            time_ms: TimeMs::default(),
        }
    }
}

/// Localises one photo.
pub(crate) fn locate(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    budget: TimeBudget,
) -> Result<Located> {
    let options = context.options;
    let results = search(context, photo, view, prior, budget)?;
    let trace = Trace {
        rounds: results.iter().map(|result| result.trace.clone()).collect(),
    };
    let mut time_ms = TimeMs::default();
    for result in &results {
        time_ms += result.time_ms;
    }
    let evidence = EvidenceUsed::of(view);
    let finalists = finalists(context, &results);
    let realigned = realign_all(context, photo, view, &finalists)?;
    time_ms += finalists::time_ms(&realigned);
    let Some(best) = best_finalist(finalists, &realigned, options) else {
        let first = results.iter().find_map(|result| result.queries.first());
        return Ok(Located {
            outcome: no_fix(reason_without_candidates(&results), None, evidence),
            features: first.map(|query| features_of(photo, query, None)),
            trace,
            time_ms,
        });
    };
    let outcome = outcome(context, photo, view, prior, &best, evidence)?;
    let query = &best.round.queries[best.verified.candidate.query];
    let verified = outcome.fix().map(|_| best.verified);
    Ok(Located {
        features: Some(features_of(photo, query, verified)),
        outcome,
        trace,
        time_ms,
    })
}

/// Searches the rounds until an answer is clear: first the most similar candidates of each, which cost little and are enough for most
/// photos under the right hypothesis, then all candidates of each.
fn search(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    budget: TimeBudget,
) -> Result<Vec<RoundResult>> {
    let mut open: Vec<OpenRound> = Vec::new();
    let mut is_over = false;
    for round in rounds(view, context.pack, context.options) {
        let mut round = OpenRound::begin(context, photo, view, prior, round)?;
        is_over = round.search(context, Depth::FirstStage, budget)? || budget.is_spent();
        open.push(round);
        if is_over {
            break;
        }
    }
    if !is_over {
        for round in &mut open {
            if round.search(context, Depth::All, budget)? || budget.is_spent() {
                break;
            }
        }
    }
    Ok(open.into_iter().map(OpenRound::finish).collect())
}

/// The features of a query of `photo`, with the fix that they gave.
fn features_of(
    photo: &Photo,
    query: &QueryFeatures,
    verified: Option<&VerifiedCandidate>,
) -> FrameFeatures {
    let (width, height) = photo.image.dimensions();
    let centre_px = Point2::new(f64::from(width) / 2.0, f64::from(height) / 2.0);
    let full_px_per_image_px = f64::from(photo.full_size_px.0) / f64::from(width.max(1));
    FrameFeatures::new(query, verified, centre_px, full_px_per_image_px)
}

/// Why no candidate was matched: too few keypoints under every hypothesis, or no tile.
fn reason_without_candidates(results: &[RoundResult]) -> Reason {
    let queries = results.iter().flat_map(|result| &result.queries);
    let found = queries.map(|query| query.points.len()).max().unwrap_or(0);
    if found < MIN_KEYPOINTS {
        Reason::TooFewKeypoints { found }
    } else {
        Reason::NoTiles
    }
}
