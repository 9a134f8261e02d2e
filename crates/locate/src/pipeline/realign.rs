//! A second matching of the best answer, with the photo rotated and scaled as that answer says and cropped less.

use std::{iter, time::Instant};

use grimnet_net::Purpose;
use grimnet_pack::Level;
use grimnet_photo::{Photo, View};
use nalgebra::Vector2;
use rayon::prelude::*;

use crate::{
    context::Context,
    error::Result,
    outcome::{Rejection, elapsed_ms},
    pipeline::{
        queries::{Queries, extract_queries},
        ranking::RankedAnswer,
        round_result::RoundResult,
        verification::{VerifiedCandidate, verify},
    },
    prior::Prior,
    search::{candidates::Candidate, hypotheses::Hypothesis},
    trace::RoundTrace,
};

/// An answer that is rotated against its hypothesis by more than this is matched again, degrees.
const REALIGN_DEG: f64 = 5.0;
/// An answer whose scale differs from its hypothesis by more than this share is matched again.
const REALIGN_SCALE: f64 = 0.06;

/// Matches the best answer again. Returns `None` if the options forbid it or nothing would change.
pub(crate) fn realign(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    best: &RankedAnswer<'_>,
) -> Result<Option<RoundResult>> {
    let Some(hypothesis) = realigned_hypothesis(context, best) else {
        return Ok(None);
    };
    let round = best.round;
    let side_px = context.options.query_side_px;
    let Queries {
        features: queries,
        dense,
        mut time_ms,
    } = extract_queries(
        context,
        photo,
        view,
        (&[hypothesis], Purpose::Answer),
        side_px,
    )?;
    let since = Instant::now();
    let (level, near) = (context.level(round.level), prior.near.as_ref());
    let verified = tiles_around(level, best.verified)
        .par_iter()
        .map(|&tile| {
            let candidate = Candidate {
                query: 0,
                tile,
                ..best.verified.candidate
            };
            verify(context, level, &[hypothesis], &queries, candidate, near)
        })
        .collect::<Result<_>>()?;
    time_ms.matching = elapsed_ms(since);
    Ok(Some(RoundResult {
        level: round.level,
        hypotheses: vec![hypothesis],
        queries,
        dense,
        verified,
        assumption: round.assumption.clone(),
        trace: RoundTrace::default(),
        time_ms,
    }))
}

/// The hypothesis that the best answer suggests; `None` if matching again is not worthwhile.
fn realigned_hypothesis(context: Context<'_>, best: &RankedAnswer<'_>) -> Option<Hypothesis> {
    let query_index = best.verified.candidate.query;
    let hypothesis = best.round.hypotheses[query_index];
    let query = &best.round.queries[query_index];
    let jacobian = best
        .verified
        .transform
        .as_ref()?
        .point_jacobian(query.centre_px.into())?;
    let right: Vector2<f64> = jacobian * Vector2::new(1.0, 0.0);
    let turn_deg = right.y.atan2(right.x).to_degrees();
    let scale = jacobian.determinant().abs().sqrt();
    let is_cropped = best.round.hypotheses.len() > 1;
    let differs = is_cropped || turn_deg.abs() > REALIGN_DEG || (scale - 1.0).abs() > REALIGN_SCALE;
    let may_pass = best.verified.rejection.is_none_or(more_matches_could_help);
    (context.options.realign && differs && may_pass).then(|| Hypothesis {
        width_m: hypothesis.width_m * scale,
        heading_deg: (hypothesis.heading_deg + turn_deg).rem_euclid(360.0),
        heading_reach_deg: 2.0 * REALIGN_DEG,
        ..hypothesis
    })
}

/// The tile of an answer, and the tile whose centre is nearest to the answer's position.
fn tiles_around(level: &Level, verified: &VerifiedCandidate) -> Vec<usize> {
    let tile = verified.candidate.tile;
    let nearest = verified
        .centre_level_px
        .and_then(|centre| level.tile_around(centre))
        .filter(|&nearest| nearest != tile);
    iter::once(tile).chain(nearest).collect()
}

/// Whether more matches could remove the reason for the rejection.
fn more_matches_could_help(rejection: Rejection) -> bool {
    matches!(
        rejection,
        Rejection::Inliers { .. }
            | Rejection::InlierShare { .. }
            | Rejection::Places { .. }
            | Rejection::Spread { .. }
    )
}
