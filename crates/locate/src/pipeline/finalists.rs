//! The finalists: the best answers at different positions over all rounds. If none is clear, each is matched again, because a wrong
//! answer on a large map can have as many matches by chance as the right one under a heading that is ten degrees off.

use grimnet_geo::{LonLat, distance_m};
use grimnet_photo::{Photo, View};
use rayon::prelude::*;

use crate::{
    context::Context,
    error::Result,
    outcome::TimeMs,
    pipeline::{
        ranking::{RankedAnswer, Rival, SAME_POSITION_PX},
        realign::realign,
        round_result::RoundResult,
    },
    prior::Prior,
};

/// The best answers at different positions, best first: one that is clear among those of all rounds alone, else up to
/// [`Options::finalists`]. The best one has the runner-up of all rounds.
pub(crate) fn finalists<'a>(
    context: Context<'_>,
    results: &'a [RoundResult],
) -> Vec<RankedAnswer<'a>> {
    let options = context.options;
    let mut answers: Vec<RankedAnswer<'a>> = results
        .iter()
        .flat_map(|result| RankedAnswer::distinct(result, options.finalists, options))
        .collect();
    // The sort is stable: of equal answers the one of the earlier round comes first.
    answers.sort_by(RankedAnswer::best_first);
    let is_clear = answers.split_first_mut().is_some_and(|(best, others)| {
        *best = best.against(&rivals_of(context, best, others), options);
        best.is_clear(options)
    });
    let most = if is_clear { 1 } else { options.finalists };
    let mut finalists: Vec<RankedAnswer<'a>> = Vec::new();
    for answer in answers {
        if finalists.len() == most {
            break;
        }
        if !finalists
            .iter()
            .any(|other| is_same_place(context, other, &answer))
        {
            finalists.push(answer);
        }
    }
    finalists
}

/// Matches each finalist again. `None` stands for one that would not change.
pub(crate) fn realign_all(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    finalists: &[RankedAnswer<'_>],
) -> Result<Vec<Option<RoundResult>>> {
    finalists
        .par_iter()
        .map(|answer| realign(context, photo, view, prior, answer))
        .collect()
}

/// The time that the second matching took.
pub(crate) fn time_ms(realigned: &[Option<RoundResult>]) -> TimeMs {
    let mut sum = TimeMs::default();
    for result in realigned.iter().flatten() {
        sum += result.time_ms;
    }
    sum
}

/// The best of the finalists after the second matching, with the best of the others as its runner-up; `None` if there are none.
pub(crate) fn best_finalist<'a>(
    context: Context<'_>,
    finalists: Vec<RankedAnswer<'a>>,
    realigned: &'a [Option<RoundResult>],
) -> Option<RankedAnswer<'a>> {
    let options = context.options;
    let mut answers: Vec<RankedAnswer<'a>> = finalists
        .into_iter()
        .zip(realigned)
        .map(|(answer, again)| {
            let again = again
                .as_ref()
                .and_then(|result| RankedAnswer::of(result, options));
            answer.or_realigned(again, options)
        })
        .collect();
    answers.sort_by(RankedAnswer::best_first);
    let (best, others) = answers.split_first()?;
    Some(best.against(&rivals_of(context, best, others), options))
}

/// The answers at other places than `best`: matched again, several may have come to one.
fn rivals_of<'a>(
    context: Context<'_>,
    best: &RankedAnswer<'a>,
    others: &[RankedAnswer<'a>],
) -> Vec<Rival<'a>> {
    let elsewhere = others
        .iter()
        .filter(|other| !is_same_place(context, best, other));
    elsewhere.map(RankedAnswer::as_rival).collect()
}

/// Whether two answers, perhaps of different levels, have the photo's centre at the same place of the map.
fn is_same_place(context: Context<'_>, a: &RankedAnswer<'_>, b: &RankedAnswer<'_>) -> bool {
    let place = |answer: &RankedAnswer<'_>| {
        let level = context.level(answer.round.level);
        let centre = level.lonlat_from_level_px(answer.verified.centre_level_px?);
        Some((centre.ok()?, level.gsd_m()))
    };
    place(a).zip(place(b)).is_some_and(|(a, b)| is_within(a, b))
}

/// Whether two places, found in pixels of so many metres, are one: pixels of the level of either, not of the map, which may be much finer
/// or coarser.
fn is_within((a, gsd_a_m): (LonLat, f64), (b, gsd_b_m): (LonLat, f64)) -> bool {
    distance_m(a, b) <= SAME_POSITION_PX * gsd_a_m.max(gsd_b_m)
}

#[cfg(test)]
mod tests {
    use grimnet_geo::destination;

    use super::*;

    #[test]
    fn places_are_one_within_so_many_pixels_of_the_coarser_level() {
        let here = LonLat::new(120.0, 24.0);
        for (gsd_a_m, gsd_b_m) in [(0.15, 0.15), (0.15, 0.6), (1.2, 0.3)] {
            let reach_m = SAME_POSITION_PX * f64::max(gsd_a_m, gsd_b_m);
            for (away_m, expected) in [(0.95 * reach_m, true), (1.05 * reach_m, false)] {
                let there = destination(here, 40.0, away_m);
                assert_eq!(is_within((here, gsd_a_m), (there, gsd_b_m)), expected);
            }
        }
    }
}
