//! The whole search in default mode: round after round until an answer is clear, then a second matching of the best answers.

use grimnet_photo::{Damage, Photo, View};
use image::{Pixel, RgbImage};
use nalgebra::Point2;

use crate::{
    context::{Context, TimeBudget},
    error::Result,
    frame_features::{FrameFeatures, scale_at},
    outcome::{EvidenceUsed, Outcome, Reason, TimeMs},
    pipeline::{
        answer::{no_fix, outcome},
        finalists::{self, best_finalist, finalists, realign_all},
        ranking::RankedAnswer,
        round_result::RoundResult,
        rounds::{BATCH, OpenRound},
        verification::VerifiedCandidate,
    },
    prior::Prior,
    query_features::{MIN_KEYPOINTS, QueryFeatures},
    search::hypotheses::{MAX_STAGED_ROUNDS, rounds},
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
        Self::without_search(Reason::DamagedPhoto { damage }, view)
    }

    /// The answer for a photo of one brightness, in which the network would find the edges of its own mask at most.
    fn blank(view: &View) -> Self {
        Self::without_search(Reason::TooFewKeypoints { found: 0 }, view)
    }

    fn without_search(reason: Reason, view: &View) -> Self {
        Self {
            outcome: no_fix(reason, None, EvidenceUsed::of(view)),
            features: None,
            trace: Trace::default(),
            time_ms: TimeMs::default(),
        }
    }
}

/// Least standard deviation of the brightness of a photo that shows anything, grey levels of 255. JPEG leaves less of a capped lens.
const LEAST_CONTRAST: f64 = 1.0;

/// Whether a photo is of one brightness: a capped lens, night, or cloud and snow overexposed.
fn is_blank(image: &RgbImage) -> bool {
    // A grid of 64 x 64 pixels is enough of any photo.
    let [step_x, step_y] = [image.width(), image.height()].map(|side| (side / 64).max(1) as usize);
    let rows = (0..image.height()).step_by(step_y);
    let pixels = rows.flat_map(|y| (0..image.width()).step_by(step_x).map(move |x| (x, y)));
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for (x, y) in pixels {
        let pixel = image.get_pixel(x, y);
        let luma = f64::from(pixel.to_luma().0[0]);
        count += 1.0;
        sum += luma;
        squares += luma * luma;
    }
    let mean = sum / count;
    squares / count - mean * mean < LEAST_CONTRAST * LEAST_CONTRAST
}

/// Localises one photo.
pub(crate) fn locate(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    budget: TimeBudget,
) -> Result<Located> {
    if is_blank(&photo.image) {
        return Ok(Located::blank(view));
    }
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
    let realigned = realign_all(context, photo, view, prior, &finalists)?;
    time_ms += finalists::time_ms(&realigned);
    let Some(best) = best_finalist(context, finalists, &realigned) else {
        let first = results.iter().find_map(|result| result.queries.first());
        return Ok(Located {
            outcome: no_fix(reason_without_candidates(&results), None, evidence),
            features: first.map(|query| features_of(photo, query, None)),
            trace,
            time_ms,
        });
    };
    let told = best.or_refused_rival(context.options);
    let inside = outcome(context, photo, view, &told, evidence.clone())?;
    let outcome = match RankedAnswer::outside_area(&results, context.options) {
        Some(outside) if inside.fix().is_none() => {
            outcome(context, photo, view, &outside, evidence)?
        }
        _ => inside,
    };
    let query = &best.round.queries[best.verified.candidate.query];
    let verified = outcome.fix().map(|_| best.verified);
    Ok(Located {
        features: Some(features_of(photo, query, verified)),
        outcome,
        trace,
        time_ms,
    })
}

/// Searches the rounds until an answer is clear: first the best of the most similar candidates of each, which cost little and are
/// enough for most photos under the right hypothesis, then further candidates of all rounds, those with the most evidence first: of
/// few rounds stage by stage, of many those that have voted already and then those that are the most similar of all.
fn search(
    context: Context<'_>,
    photo: &Photo,
    view: &View,
    prior: &Prior,
    budget: TimeBudget,
) -> Result<Vec<RoundResult>> {
    let options = context.options;
    let rounds = rounds(view, context.pack, options);
    let first_look = if rounds.len() > 1 {
        options.first_matched.min(options.max_matched)
    } else {
        options.max_matched
    };
    let mut open: Vec<OpenRound> = Vec::new();
    let mut is_over = false;
    for round in rounds {
        let mut round = OpenRound::begin(context, photo, view, prior, (round, &open))?;
        round.begin_stage(context)?;
        let matched = round.match_next(context, first_look, budget)?;
        open.push(round);
        is_over = matched.is_clear || budget.is_spent();
        if is_over {
            break;
        }
    }
    if open.len() > MAX_STAGED_ROUNDS {
        // Half of them before the others enter, among which wrong ones may get more votes than the right one.
        let early = options.joint_matched / 2;
        if !is_over && !match_best(context, &mut open, early, budget)? {
            enter_best(context, &mut open)?;
            match_best(context, &mut open, options.joint_matched - early, budget)?;
        }
    } else {
        let most = options.max_matched.saturating_mul(open.len());
        while !is_over {
            let mut has_begun = false;
            for round in &mut open {
                has_begun |= round.begin_stage(context)?;
            }
            is_over =
                !has_begun || budget.is_spent() || match_best(context, &mut open, most, budget)?;
        }
    }
    let mut results: Vec<RoundResult> = open.into_iter().map(OpenRound::finish).collect();
    let hypotheses = || results.iter().flat_map(|result| &result.hypotheses);
    if hypotheses().any(|hypothesis| hypothesis.is_width_searched) {
        // An answer under the stated width is then the best of all widths, too.
        let all = results.iter_mut().flat_map(|result| &mut result.hypotheses);
        all.for_each(|hypothesis| hypothesis.is_width_searched = true);
    }
    Ok(results)
}

/// Lets the [`Options::joint_candidates`](crate::Options) with the best scores of all rounds enter, each in its round, and the best of
/// all that have entered vote again: evidence is comparable between votes with as many keypoints only.
fn enter_best(context: Context<'_>, open: &mut [OpenRound]) -> Result<()> {
    let options = context.options;
    let scores = open.iter().flat_map(OpenRound::waiting_scores);
    let least = least_of_largest(scores.collect(), options.joint_candidates);
    for round in &mut *open {
        round.enter_scored(context, least)?;
    }
    let Some(recount) = options.vote.and_then(|vote| vote.recount) else {
        return Ok(());
    };
    let evidence = open
        .iter()
        .flat_map(|round| round.entered_evidence(options));
    let least = least_of_largest(evidence.collect(), recount.candidates);
    open.iter_mut()
        .try_for_each(|round| round.recount(context, recount.keypoints, least))
}

/// The least of the `count` largest values; minus infinity if there are no more.
fn least_of_largest(mut values: Vec<f64>, count: usize) -> f64 {
    if count >= values.len() {
        return f64::NEG_INFINITY;
    }
    let (_, least, _) =
        values.select_nth_unstable_by(count.saturating_sub(1), |a, b| b.total_cmp(a));
    *least
}

/// Matches candidates of all rounds, those with the most evidence first, until an answer is clear, the time is used up, or `most` are
/// matched. Whether the search is over.
fn match_best(
    context: Context<'_>,
    open: &mut [OpenRound],
    most: usize,
    budget: TimeBudget,
) -> Result<bool> {
    let options = context.options;
    let mut left = most;
    while left > 0 {
        let next = open
            .iter_mut()
            .filter_map(|round| Some((round.next_evidence(options)?, round)))
            .reduce(|a, b| if b.0 > a.0 { b } else { a });
        let Some((_, round)) = next else {
            break;
        };
        let matched = round.match_next(context, BATCH.min(left), budget)?;
        if matched.is_clear || budget.is_spent() {
            return Ok(true);
        }
        left = left.saturating_sub(matched.count);
    }
    Ok(false)
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

/// A photo of fewer pixels at the map's resolution shows nothing, however much texture it has: a few cells of the keypoint detector.
const MIN_VISIBLE_SIDE_PX: f64 = 64.0;

/// A photo of which one pixel covers more of the map's is so blurred at their resolution that no keypoint is found, however sharp it is.
const MAX_ACROSS_PX: f64 = 8.0;

/// Why no candidate was matched: too few keypoints under every hypothesis, or no tile.
fn reason_without_candidates(results: &[RoundResult]) -> Reason {
    let queries = || results.iter().flat_map(|result| result.queries.iter());
    let found = queries().map(|query| query.points.len()).max().unwrap_or(0);
    let side_px = queries()
        .map(|query| 2.0 * query.half_side_px)
        .fold(0.0, f64::max);
    let across_px = queries()
        .map(|query| 1.0 / scale_at(&query.photo_px_from_query_px, query))
        .fold(f64::INFINITY, f64::min);
    if found >= MIN_KEYPOINTS {
        Reason::NoTiles
    } else if side_px < MIN_VISIBLE_SIDE_PX {
        Reason::TooFewPixels { side_px }
    } else if across_px.is_finite() && across_px > MAX_ACROSS_PX {
        Reason::TooMuchGround { across_px }
    } else {
        Reason::TooFewKeypoints { found }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_with_a_black_border_is_not_blank() {
        for (width, height) in [(640, 512), (512, 512), (640, 480), (100, 4096), (7, 5)] {
            let textured = RgbImage::from_fn(width, height, |x, y| {
                let level = if x < 2 { 0 } else { (x * 37 + y * 91) % 200 };
                image::Rgb([level as u8; 3])
            });
            assert!(!is_blank(&textured), "{width} x {height}");
            assert!(is_blank(&RgbImage::new(width, height)));
        }
    }

    #[test]
    fn the_least_of_the_largest_leaves_so_many() {
        let values = vec![0.2, 0.9, -0.3, 0.5, 0.7];
        for count in 1..values.len() {
            let least = least_of_largest(values.clone(), count);
            assert_eq!(values.iter().filter(|&&v| v >= least).count(), count);
        }
        for count in [5, 6] {
            assert_eq!(least_of_largest(values.clone(), count), f64::NEG_INFINITY);
        }
    }
}
