//! Fits the probability that an answer is right to its support, by logistic regression (Cox 1958), and the least confidence that
//! one photo in a thousand taken elsewhere exceeds.

use grimnet_net::Confidence;
use nalgebra::{SMatrix, SVector};

use super::error::FitError;
use super::observation::Observation;

/// Least number of photos taken elsewhere for an estimate of the tail.
const MIN_ELSEWHERE: usize = 40;
const MIN_RIGHT: usize = 40;
/// Least number of real photos taken elsewhere that set the limit alone.
const MIN_REAL_ELSEWHERE: usize = 400;

/// Default share of photos taken elsewhere that may get a fix.
pub const ELSEWHERE_ANSWERED: f64 = 1e-3;

/// Share of the answers to photos taken elsewhere that form the extrapolated tail.
const TAIL_SHARE: f64 = 0.05;
/// Least number of photos in that tail; of few answers it is their upper half.
const MIN_TAIL: usize = 60;

/// Precision of the prior on each standardised weight (ridge): right and wrong answers may be separable, and the likelihood
/// then has no maximum.
const RIDGE: f64 = 1.0;

/// A step of the fit that is smaller ends it.
const SMALLEST_STEP: f64 = 1e-10;

/// Intercept and five weights.
const TERMS: usize = 6;
type Terms = SVector<f64, TERMS>;

/// The photos taken elsewhere that set the limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limiting {
    /// Real ones: procedural worlds resemble each other more than real places do.
    Real,
    /// All, where there are not enough real ones.
    All,
}

impl Limiting {
    /// What a whole set of observations has enough of. Its halves are fitted by the same rule.
    #[must_use]
    pub fn of(observations: &[Observation]) -> Self {
        let real = observations.iter().filter(|o| o.elsewhere && o.real);
        if real.count() >= MIN_REAL_ELSEWHERE {
            Self::Real
        } else {
            Self::All
        }
    }

    fn includes(self, observation: &Observation) -> bool {
        observation.elsewhere && (self == Self::All || observation.real)
    }
}

/// Checks that there are enough right answers and photos taken elsewhere.
pub(super) fn check_enough(right: usize, elsewhere: usize) -> Result<(), FitError> {
    if right < MIN_RIGHT {
        return Err(FitError::TooFewFixes {
            found: right,
            needed: MIN_RIGHT,
        });
    }
    if elsewhere < MIN_ELSEWHERE {
        return Err(FitError::TooFewElsewhere {
            found: elsewhere,
            needed: MIN_ELSEWHERE,
        });
    }
    Ok(())
}

/// Fits the weights to right and wrong answers, then the least confidence so that a share `allowed` of the photos taken elsewhere, those
/// that `limiting` names, exceeds it.
///
/// # Errors
/// Too few of either.
pub fn fit(
    observations: &[Observation],
    allowed: f64,
    limiting: Limiting,
) -> Result<Confidence, FitError> {
    let answers: Vec<([f64; TERMS - 1], bool)> = observations
        .iter()
        .filter_map(|o| Some((o.answer?.support.evidence(), o.is_right())))
        .collect();
    check_enough(
        answers.iter().filter(|(_, right)| *right).count(),
        observations.iter().filter(|o| o.elsewhere).count(),
    )?;
    let weights = logistic(&answers);
    let [
        intercept,
        log_places,
        log_lead,
        log_excess,
        log_spread,
        held_back,
    ] = weights.into();
    let mut model = Confidence {
        intercept,
        log_places,
        log_lead,
        log_excess,
        log_spread,
        held_back,
        needed: 0.0,
    };
    let taken = |limiting: Limiting| -> Vec<&Observation> {
        let elsewhere = observations.iter();
        elsewhere.filter(|o| limiting.includes(o)).collect()
    };
    // A half of the scenes may have none of the real ones, as where all are of one folder.
    let elsewhere = match taken(limiting) {
        named if named.is_empty() => taken(Limiting::All),
        named => named,
    };
    let log_odds: Vec<f64> = elsewhere
        .iter()
        .filter_map(|o| Some(log_odds(o.answer?.support.confidence(&model))))
        .collect();
    let limit = tail_limit(log_odds, elsewhere.len(), allowed);
    model.needed = probability(limit);
    Ok(model)
}

fn log_odds(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

/// The probability of these log odds, none with smaller ones: near one the log odds have more digits, and what lies just below a limit
/// would be rounded to it.
fn probability(limit: f64) -> f64 {
    let mut probability = 1.0 / (1.0 + (-limit).exp());
    while log_odds(probability) < limit {
        probability = probability.next_up();
    }
    probability
}

/// The value that a share `allowed` of `photos` exceeds. The best of many chance matches has an exponential tail
/// (Gumbel 1958), whose scale is the mean excess over its beginning.
fn tail_limit(mut values: Vec<f64>, photos: usize, allowed: f64) -> f64 {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    let count = ((values.len() as f64 * TAIL_SHARE).ceil() as usize)
        .max(MIN_TAIL)
        .min(values.len().div_ceil(2))
        .max(1);
    let Some(first) = values.len().checked_sub(count) else {
        // No photo taken elsewhere has an answer: even odds are the limit.
        return 0.0;
    };
    let start = values[first];
    let excess = values[first..].iter().map(|v| v - start).sum::<f64>() / count as f64;
    let reached = count as f64 / photos as f64;
    let extrapolated = start + excess * (reached / allowed).ln().max(0.0);
    // No more than allowed are above it among those that were seen, either: several maps together have a longer tail.
    let above = (allowed * photos as f64) as usize;
    let seen = values
        .len()
        .checked_sub(above + 1)
        .map(|index| values[index]);
    seen.map_or(extrapolated, |seen| extrapolated.max(seen.next_up()))
}

/// Newton's method on the standardised evidence, each step halved until it is no loss: full steps go round in circles where some of the
/// evidence lies far out. Returns the weights of the unscaled evidence.
fn logistic(answers: &[([f64; TERMS - 1], bool)]) -> Terms {
    let count = answers.len() as f64;
    let mut mean = [0.0; TERMS - 1];
    let mut deviation = [0.0; TERMS - 1];
    for i in 0..TERMS - 1 {
        mean[i] = answers.iter().map(|a| a.0[i]).sum::<f64>() / count;
        let square = answers
            .iter()
            .map(|a| (a.0[i] - mean[i]).powi(2))
            .sum::<f64>();
        deviation[i] = (square / count).sqrt().max(1e-9);
    }
    let rows: Vec<(Terms, f64)> = answers
        .iter()
        .map(|(evidence, right)| {
            let at = |i: usize| (evidence[i] - mean[i]) / deviation[i];
            (
                Terms::from([1.0, at(0), at(1), at(2), at(3), at(4)]),
                f64::from(u8::from(*right)),
            )
        })
        .collect();
    let mut ridge = SMatrix::<f64, TERMS, TERMS>::identity() * RIDGE;
    ridge[(0, 0)] = 1e-9;
    // The negative logarithm of the posterior.
    let cost = |weights: &Terms| -> f64 {
        let misfit = |(row, target): &(Terms, f64)| {
            let margin = (2.0 * target - 1.0) * row.dot(weights);
            (-margin).max(0.0) + (-margin.abs()).exp().ln_1p()
        };
        0.5 * weights.dot(&(ridge * weights)) + rows.iter().map(misfit).sum::<f64>()
    };
    let mut weights = Terms::zeros();
    let mut reached = cost(&weights);
    for _ in 0..60 {
        let mut gradient = ridge * -weights;
        let mut hessian = ridge;
        for (row, target) in &rows {
            let p = 1.0 / (1.0 + (-row.dot(&weights)).exp());
            gradient += row * (target - p);
            hessian += row * row.transpose() * (p * (1.0 - p));
        }
        let Some(factor) = hessian.cholesky() else {
            break;
        };
        let mut step = factor.solve(&gradient);
        let mut next = cost(&(weights + step));
        while next > reached && step.norm() >= SMALLEST_STEP {
            step *= 0.5;
            next = cost(&(weights + step));
        }
        if next <= reached {
            weights += step;
            reached = next;
        }
        if step.norm() < SMALLEST_STEP {
            break;
        }
    }
    let mut plain = weights;
    for i in 0..TERMS - 1 {
        plain[i + 1] = weights[i + 1] / deviation[i];
        plain[0] -= plain[i + 1] * mean[i];
    }
    plain
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_than_the_allowed_share_of_those_seen_exceeds_the_limit() {
        // A long tail on one map among many short ones: the mean excess alone would let three of 2,000 pass.
        let short = (0..1997).map(|i| -10.0 - f64::from(i % 100) / 100.0);
        let values: Vec<f64> = short.chain([-3.0, -2.0, -1.0]).collect();
        let limit = tail_limit(values.clone(), 2000, 1e-3);
        assert_eq!(values.iter().filter(|&&v| v >= limit).count(), 2);
        // One in a hundred: far below all three.
        let limit = tail_limit(values, 2000, 1e-2);
        assert!(limit < -9.0, "{limit}");
    }

    #[test]
    fn the_answer_that_sets_the_limit_is_below_the_least_confidence() {
        for i in 1..1000 {
            let seen = f64::from(i) / 1000.0;
            let needed = probability(log_odds(seen).next_up());
            assert!(seen < needed && needed < seen + 1e-12, "{seen} {needed}");
        }
        assert_eq!(probability(0.0), 0.5);
        assert_eq!(probability(50.0), 1.0);
    }

    #[test]
    fn evidence_that_lies_far_out_does_not_keep_the_fit_from_its_maximum() {
        // Newton's full steps have no end with these.
        let mut state = 9_u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / 4_294_967_296.0
        };
        let answers: Vec<([f64; TERMS - 1], bool)> = (0..200)
            .map(|i| {
                let right = i % 2 == 1;
                let mut evidence = [0.0; TERMS - 1];
                for (j, value) in (1..).zip(&mut evidence) {
                    let shift = if right { 6.0 * f64::from(j) / 5.0 } else { 0.0 };
                    *value = 2.0 * uniform() - 1.0 + shift;
                    if uniform() < 0.02 {
                        *value += 160.0 * uniform() - 80.0;
                    }
                }
                (evidence, right)
            })
            .collect();
        let weights = logistic(&answers);
        // At the maximum as many are right as the probabilities add up to.
        let residual = |(evidence, right): &([f64; TERMS - 1], bool)| {
            let weighted = (0..TERMS - 1).map(|i| weights[i + 1] * evidence[i]);
            let log_odds = weights[0] + weighted.sum::<f64>();
            f64::from(u8::from(*right)) - 1.0 / (1.0 + (-log_odds).exp())
        };
        let sum: f64 = answers.iter().map(residual).sum();
        assert!(sum.abs() < 1e-5, "{sum}");
    }

    #[test]
    fn the_tail_is_extrapolated_beyond_what_was_seen() {
        // Quantiles of an exponential distribution of scale 1: one in a thousand exceeds ln 1000.
        let values = (0..400)
            .map(|i| -((f64::from(i) + 0.5) / 400.0).ln())
            .collect();
        let limit = tail_limit(values, 400, 1e-4);
        assert!((limit - 1e4_f64.ln()).abs() < 0.5, "{limit}");
    }

    #[test]
    fn the_tail_of_few_answers_is_their_upper_half() {
        // Of a logistic distribution one in a thousand exceeds 6.9; by the mean excess over the least of all it would be 27.
        let values = (0..48).map(|i| log_odds((f64::from(i) + 0.5) / 48.0));
        let limit = tail_limit(values.collect(), 48, 1e-3);
        assert!((6.0..9.0).contains(&limit), "{limit}");
    }
}
