//! Which of the verified candidates wins, and by how much.

use std::cmp::Ordering;

use nalgebra::Vector2;

use crate::{
    options::{Choice, Options},
    outcome::Rejection,
    pipeline::{round_result::RoundResult, verification::VerifiedCandidate},
};

/// Answers within this distance of each other are at the same position, level pixels.
pub(crate) const SAME_POSITION_PX: f64 = 32.0;

/// The best answer of one round.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RankedAnswer<'a> {
    pub round: &'a RoundResult,
    pub verified: &'a VerifiedCandidate,
    /// The best candidate at another position.
    pub runner_up: Option<Rival<'a>>,
    /// The first gate that the answer does not pass, the margin over the runner-up included.
    pub rejection: Option<Rejection>,
}

/// A candidate at another position than an answer.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rival<'a> {
    pub round: &'a RoundResult,
    pub verified: &'a VerifiedCandidate,
}

impl<'a> RankedAnswer<'a> {
    /// The best answer of a round; `None` if no candidate was matched.
    pub fn of(round: &'a RoundResult, options: &Options) -> Option<Self> {
        let (verified, runner_up) = best_candidate(&round.verified, options)?;
        Some(Self::new(round, verified, runner_up, options))
    }

    /// The best answer outside of the given area, if its inliers are too many for chance.
    pub fn outside_area(rounds: &'a [RoundResult], options: &Options) -> Option<Self> {
        let of_round = |round: &'a RoundResult| {
            let outside = round
                .verified
                .iter()
                .filter(|other| !is_in_area(other) && other.inliers.len() >= options.clear_inliers);
            Some((round, best_of(outside, options)?))
        };
        rounds
            .iter()
            .filter_map(of_round)
            .max_by(|(_, a), (_, b)| a.weighted_inliers().total_cmp(&b.weighted_inliers()))
            .map(|(round, verified)| Self::new(round, verified, None, options))
    }

    /// The best answers of a round at different positions, best first, at most `most`.
    pub fn distinct(round: &'a RoundResult, most: usize, options: &Options) -> Vec<Self> {
        let mut left: Vec<&VerifiedCandidate> = round.verified.iter().collect();
        let mut answers = Vec::new();
        while answers.len() < most
            && let Some(best) = best_of(left.iter().copied(), options)
        {
            left.retain(|other| !same_position(other, best));
            let others = round.verified.iter();
            let runner_up = most_inliers(others.filter(|other| !same_position(other, best)));
            answers.push(Self::new(round, best, runner_up, options));
        }
        answers
    }

    fn new(
        round: &'a RoundResult,
        verified: &'a VerifiedCandidate,
        runner_up: Option<&'a VerifiedCandidate>,
        options: &Options,
    ) -> Self {
        Self {
            round,
            verified,
            runner_up: runner_up.map(|verified| Rival { round, verified }),
            rejection: verified
                .rejection
                .or_else(|| margin_rejection(verified, runner_up, options)),
        }
    }

    /// This answer with the best of `rivals` and its own runner-up as runner-up.
    pub fn against(self, rivals: &[Rival<'a>], options: &Options) -> Self {
        let inliers = |rival: &Rival<'_>| rival.verified.inliers.len();
        let rivals = rivals.iter().copied();
        let rivals = rivals.filter(|rival| is_in_area(rival.verified));
        let all = self.runner_up.into_iter().chain(rivals);
        let runner_up = all.reduce(|a, b| if inliers(&b) > inliers(&a) { b } else { a });
        let second = runner_up.map(|rival| rival.verified);
        Self {
            runner_up,
            rejection: self
                .verified
                .rejection
                .or_else(|| margin_rejection(self.verified, second, options)),
            ..self
        }
    }

    /// This answer as a rival of others.
    pub fn as_rival(&self) -> Rival<'a> {
        Rival {
            round: self.round,
            verified: self.verified,
        }
    }

    /// The runner-up in place of this answer if it has more inliers and a gate refuses it: two places do not look alike there. Of a tilted photo
    /// an answer by chance may pass the gates that the right one does not.
    pub fn or_refused_rival(self, options: &Options) -> Self {
        let Some(Rejection::Ambiguous { inliers, runner_up }) = self.rejection else {
            return self;
        };
        let refused = self
            .runner_up
            .filter(|rival| runner_up > inliers && rival.verified.rejection.is_some());
        refused.map_or(self, |Rival { round, verified }| {
            Self::new(round, verified, None, options)
        })
    }

    fn second(&self) -> Option<&'a VerifiedCandidate> {
        self.runner_up.map(|rival| rival.verified)
    }

    /// Whether the answer is so clear that no further round is needed.
    pub fn is_clear(&self, options: &Options) -> bool {
        is_clear(self.verified, self.second(), options)
    }

    /// The realigned answer if it passes the gates at the same position with inliers that count at least as much, else this one. The runner-up
    /// is kept, because realigning looks at one position only.
    pub fn or_realigned(self, realigned: Option<Self>, options: &Options) -> Self {
        let is_better = |realigned: &Self| {
            realigned.verified.rejection.is_none()
                && same_position(realigned.verified, self.verified)
                && (self.verified.rejection.is_some()
                    || realigned.verified.weighted_inliers() >= self.verified.weighted_inliers())
        };
        let Some(realigned) = realigned.filter(is_better) else {
            return self;
        };
        let rejection = margin_rejection(realigned.verified, self.second(), options);
        if rejection.is_some() && self.rejection.is_none() {
            return self;
        }
        Self {
            runner_up: self.runner_up,
            rejection,
            ..realigned
        }
    }

    /// The order of answers of several rounds, best first: those that pass the gates, then by what their inliers count. The margin does not
    /// count: an answer that has a rival of its own is not worse than one by chance that has none.
    pub fn best_first(a: &Self, b: &Self) -> Ordering {
        let passes = |answer: &Self| answer.verified.rejection.is_none();
        let inliers = |answer: &Self| answer.verified.weighted_inliers();
        passes(b)
            .cmp(&passes(a))
            .then_with(|| inliers(b).total_cmp(&inliers(a)))
    }
}

/// Number of inliers of the best candidate at another position; 0 if there is none.
pub(crate) fn runner_up_inliers(runner_up: Option<&VerifiedCandidate>) -> usize {
    runner_up.map_or(0, |other| other.inliers.len())
}

/// The rejection by the gate on the margin over the runner-up, if it does not pass.
fn margin_rejection(
    best: &VerifiedCandidate,
    runner_up: Option<&VerifiedCandidate>,
    options: &Options,
) -> Option<Rejection> {
    options
        .gates?
        .check_margin(best.inliers.len(), runner_up_inliers(runner_up))
        .err()
}

/// Whether the best candidate is so clear that no further candidate is needed.
fn is_clear(
    best: &VerifiedCandidate,
    runner_up: Option<&VerifiedCandidate>,
    options: &Options,
) -> bool {
    // Twice the runner-up, because a better candidate may still follow.
    best.rejection.is_none()
        && best.inliers.len() >= options.clear_inliers
        && best.inliers.len() >= 2 * runner_up_inliers(runner_up)
}

/// The best candidate if it is so clear that no further one need be matched.
pub(crate) fn clear_candidate<'a>(
    verified: &'a [VerifiedCandidate],
    options: &Options,
) -> Option<&'a VerifiedCandidate> {
    let (best, runner_up) = best_candidate(verified, options)?;
    is_clear(best, runner_up, options).then_some(best)
}

/// The best candidate and the one with the most inliers at another position.
pub(crate) fn best_candidate<'a>(
    verified: &'a [VerifiedCandidate],
    options: &Options,
) -> Option<(&'a VerifiedCandidate, Option<&'a VerifiedCandidate>)> {
    let best = best_of(verified.iter(), options)?;
    let others = verified.iter().filter(|other| !same_position(other, best));
    Some((best, most_inliers(others)))
}

/// The best candidate, by inliers or by the paper's eq. 20. Those that pass the gates come first; of equal ones the first, which the vote
/// ranks higher.
fn best_of<'a>(
    verified: impl Iterator<Item = &'a VerifiedCandidate>,
    options: &Options,
) -> Option<&'a VerifiedCandidate> {
    let rank = |verified: &VerifiedCandidate| {
        let score = match options.choice {
            Choice::Inliers => verified.weighted_inliers(),
            Choice::InlierRatio => {
                verified.inliers.len() as f64 / (verified.pairs.len() as f64 + 1.0)
            }
        };
        (verified.rejection.is_none(), score)
    };
    verified.reduce(|a, b| if rank(b) > rank(a) { b } else { a })
}

/// Whether a candidate is in the given area, if there is one: a place outside of it looks alike in vain.
fn is_in_area(verified: &VerifiedCandidate) -> bool {
    verified.rejection != Some(Rejection::OutsideArea)
}

/// The candidate of the area with the most inliers; the first of equal ones.
fn most_inliers<'a>(
    candidates: impl Iterator<Item = &'a VerifiedCandidate>,
) -> Option<&'a VerifiedCandidate> {
    candidates.filter(|other| is_in_area(other)).reduce(|a, b| {
        if b.inliers.len() > a.inliers.len() {
            b
        } else {
            a
        }
    })
}

fn same_position(a: &VerifiedCandidate, b: &VerifiedCandidate) -> bool {
    match (a.centre_level_px, b.centre_level_px) {
        (Some(a), Some(b)) => Vector2::new(a.x - b.x, a.y - b.y).norm() <= SAME_POSITION_PX,
        _ => std::ptr::eq(a, b),
    }
}

#[cfg(test)]
mod tests {
    use grimnet_geo::LevelPx;

    use super::*;
    use crate::{
        outcome::TimeMs, search::candidates::Candidate, search::vote::Peak, trace::RoundTrace,
    };

    /// A candidate at `x_px` with so many inliers.
    fn verified(x_px: f64, inliers: usize) -> VerifiedCandidate {
        VerifiedCandidate {
            candidate: Candidate {
                query: 0,
                tile: 0,
                similarity: 0.0,
                score: 0.0,
                peak: Peak::default(),
            },
            pairs: Vec::new(),
            inliers: (0..inliers).collect(),
            transform: None,
            covariance_px2: None,
            expected_inliers: 1.0,
            inlier_weight: 1.0,
            centre_level_px: Some(LevelPx { x: x_px, y: 0.0 }),
            rejection: None,
        }
    }

    fn round(level: usize, verified: Vec<VerifiedCandidate>) -> RoundResult {
        RoundResult {
            level,
            hypotheses: Vec::new(),
            queries: [].into(),
            dense: None,
            verified,
            assumption: String::new(),
            trace: RoundTrace::default(),
            time_ms: TimeMs::default(),
        }
    }

    fn inliers(answer: &RankedAnswer<'_>) -> (usize, usize) {
        let second = runner_up_inliers(answer.second());
        (answer.verified.inliers.len(), second)
    }

    #[test]
    fn one_answer_of_each_position_is_listed_with_the_best_of_the_others() {
        let result = round(
            0,
            vec![
                verified(0.0, 20),
                verified(300.0, 26),
                verified(10.0, 24),
                verified(310.0, 25),
                verified(900.0, 9),
            ],
        );
        let options = Options::default();
        let all: Vec<_> = RankedAnswer::distinct(&result, 5, &options)
            .iter()
            .map(inliers)
            .collect();
        assert_eq!(all, [(26, 24), (24, 26), (9, 26)]);
        assert_eq!(RankedAnswer::distinct(&result, 2, &options).len(), 2);
        let best = RankedAnswer::of(&result, &options).unwrap();
        assert_eq!(inliers(&best), (26, 24));
    }

    #[test]
    fn inliers_of_an_improbable_scale_count_less() {
        let roof = VerifiedCandidate {
            inlier_weight: 0.6,
            ..verified(20.0, 39)
        };
        let (stated, nearer) = (
            round(0, vec![verified(0.0, 33)]),
            round(0, vec![roof.clone()]),
        );
        let options = Options::default();
        let of = |result| RankedAnswer::of(result, &options).unwrap();
        let order = RankedAnswer::best_first(&of(&stated), &of(&nearer));
        assert_eq!(order, Ordering::Less);
        let both = round(0, vec![roof, verified(0.0, 33)]);
        assert_eq!(inliers(&of(&both)), (33, 0), "a roof is no rival");
    }

    #[test]
    fn a_place_outside_the_area_is_neither_best_nor_runner_up() {
        let outside = VerifiedCandidate {
            rejection: Some(Rejection::OutsideArea),
            ..verified(500.0, 60)
        };
        let all = [verified(0.0, 50), outside.clone(), verified(900.0, 9)];
        let result = round(0, all.to_vec());
        let options = Options::default();
        let best = RankedAnswer::of(&result, &options).unwrap();
        assert_eq!(inliers(&best), (50, 9));
        assert!(best.is_clear(&options));
        let elsewhere = round(0, vec![outside]);
        let rival = RankedAnswer::of(&elsewhere, &options).unwrap();
        assert_eq!(
            inliers(&best.against(&[rival.as_rival()], &options)),
            (50, 9)
        );
    }

    #[test]
    fn places_that_look_alike_come_before_chance_answers_of_other_rounds() {
        let alike = round(0, vec![verified(0.0, 243), verified(900.0, 232)]);
        let chance = round(1, vec![verified(400.0, 20)]);
        let options = Options {
            gates: Some(crate::Gates::default().with_calibration()),
            ..Options::default()
        };
        let [alike, chance] =
            [&alike, &chance].map(|round| RankedAnswer::of(round, &options).unwrap());
        assert!(matches!(alike.rejection, Some(Rejection::Ambiguous { .. })));
        assert_eq!(RankedAnswer::best_first(&alike, &chance), Ordering::Less);
    }

    #[test]
    fn a_chance_answer_does_not_hide_why_the_best_place_is_refused() {
        let options = Options {
            gates: Some(crate::Gates::default().with_calibration()),
            ..Options::default()
        };
        let sheared = Rejection::Shear { shear: 0.8 };
        let tilted = VerifiedCandidate {
            rejection: Some(sheared),
            ..verified(900.0, 319)
        };
        let result = round(1, vec![verified(0.0, 26), tilted]);
        let best = RankedAnswer::of(&result, &options).unwrap();
        assert_eq!(inliers(&best), (26, 319));
        let told = best.or_refused_rival(&options);
        assert_eq!(told.rejection, Some(sheared));
        assert_eq!((told.round.level, inliers(&told)), (1, (319, 0)));
        // Two places that pass the gates do look alike.
        let alike = round(0, vec![verified(0.0, 243), verified(900.0, 232)]);
        let alike = RankedAnswer::of(&alike, &options).unwrap();
        assert!(matches!(
            alike.or_refused_rival(&options).rejection,
            Some(Rejection::Ambiguous { .. })
        ));
    }

    #[test]
    fn the_best_place_outside_the_area_is_named_if_it_is_no_chance() {
        let outside = |inliers| VerifiedCandidate {
            rejection: Some(Rejection::OutsideArea),
            ..verified(500.0, inliers)
        };
        let options = Options::default();
        let rounds = [
            round(0, vec![verified(0.0, 9), outside(60)]),
            round(1, vec![outside(80)]),
        ];
        let found = RankedAnswer::outside_area(&rounds, &options).unwrap();
        assert_eq!((found.round.level, inliers(&found)), (1, (80, 0)));
        assert_eq!(found.rejection, Some(Rejection::OutsideArea));
        let chance = [round(0, vec![verified(0.0, 60), outside(12)])];
        assert!(RankedAnswer::outside_area(&chance, &options).is_none());
    }

    #[test]
    fn a_rival_of_another_round_becomes_the_runner_up_if_it_is_better() {
        let (fine, coarse) = (
            round(0, vec![verified(0.0, 30), verified(300.0, 12)]),
            round(1, vec![verified(700.0, 22)]),
        );
        let options = Options::default();
        let of = |result| RankedAnswer::of(result, &options).unwrap();
        let best = of(&fine).against(&[of(&coarse).as_rival()], &options);
        assert_eq!(inliers(&best), (30, 22));
        assert_eq!(best.runner_up.unwrap().round.level, 1);
        let alone = of(&fine).against(&[], &options);
        assert_eq!(
            (inliers(&alone), alone.runner_up.unwrap().round.level),
            ((30, 12), 0)
        );
    }
}
