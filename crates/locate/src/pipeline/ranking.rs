//! Which of the verified candidates wins, and by how much.

use nalgebra::Vector2;

use crate::{
    options::{Choice, Options},
    outcome::Rejection,
    pipeline::{round_result::RoundResult, verification::VerifiedCandidate},
};

/// Answers within this distance of each other are at the same position, level pixels.
const SAME_POSITION_PX: f64 = 32.0;

/// The best answer of one round.
#[derive(Debug)]
pub(crate) struct RankedAnswer<'a> {
    pub round: &'a RoundResult,
    pub verified: &'a VerifiedCandidate,
    /// The best candidate at another position.
    pub runner_up: Option<&'a VerifiedCandidate>,
    /// The first gate that the answer does not pass, the margin over the runner-up included.
    pub rejection: Option<Rejection>,
}

impl<'a> RankedAnswer<'a> {
    /// The best answer of a round; `None` if no candidate was matched.
    pub fn of(round: &'a RoundResult, options: &Options) -> Option<Self> {
        let (verified, runner_up) = best_candidate(&round.verified, options)?;
        Some(Self {
            round,
            verified,
            runner_up,
            rejection: verified
                .rejection
                .or_else(|| margin_rejection(verified, runner_up, options)),
        })
    }

    /// Whether the answer is so clear that no further round is needed.
    pub fn is_clear(&self, options: &Options) -> bool {
        is_clear(self.verified, self.runner_up, options)
    }

    /// The realigned answer if it passes the gates at the same position with at least as many inliers, else this one. The runner-up
    /// is kept, because realigning looks at one position only.
    pub fn or_realigned(self, realigned: Option<Self>, options: &Options) -> Self {
        let is_better = |realigned: &Self| {
            realigned.verified.rejection.is_none()
                && same_position(realigned.verified, self.verified)
                && (self.rejection.is_some()
                    || realigned.verified.inliers.len() >= self.verified.inliers.len())
        };
        let Some(realigned) = realigned.filter(is_better) else {
            return self;
        };
        let rejection = margin_rejection(realigned.verified, self.runner_up, options);
        if rejection.is_some() && self.rejection.is_none() {
            return self;
        }
        Self {
            runner_up: self.runner_up,
            rejection,
            ..realigned
        }
    }

    /// The key by which answers of several rounds are compared: passing the gates first, then the number of inliers.
    pub fn rank(&self) -> (bool, usize) {
        (self.rejection.is_none(), self.verified.inliers.len())
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
pub(crate) fn is_clear(
    best: &VerifiedCandidate,
    runner_up: Option<&VerifiedCandidate>,
    options: &Options,
) -> bool {
    // Twice the runner-up, because a better candidate may still follow.
    best.rejection.is_none()
        && best.inliers.len() >= options.clear_inliers
        && best.inliers.len() >= 2 * runner_up_inliers(runner_up)
}

/// The best candidate and the best one at another position. Candidates that pass the gates come first.
pub(crate) fn best_candidate<'a>(
    verified: &'a [VerifiedCandidate],
    options: &Options,
) -> Option<(&'a VerifiedCandidate, Option<&'a VerifiedCandidate>)> {
    let rank = |verified: &VerifiedCandidate| {
        let inliers = verified.inliers.len() as f64;
        let score = match options.choice {
            Choice::Inliers => inliers,
            Choice::InlierRatio => inliers / (verified.pairs.len() as f64 + 1.0),
        };
        (verified.rejection.is_none(), score)
    };
    // Of equal candidates the first wins, which the vote ranks higher.
    let best = verified
        .iter()
        .reduce(|a, b| if rank(b) > rank(a) { b } else { a })?;
    let others = verified.iter().filter(|other| !same_position(other, best));
    let runner_up = others.reduce(|a, b| {
        if b.inliers.len() > a.inliers.len() {
            b
        } else {
            a
        }
    });
    Some((best, runner_up))
}

fn same_position(a: &VerifiedCandidate, b: &VerifiedCandidate) -> bool {
    match (a.centre_level_px, b.centre_level_px) {
        (Some(a), Some(b)) => Vector2::new(a.x - b.x, a.y - b.y).norm() <= SAME_POSITION_PX,
        _ => std::ptr::eq(a, b),
    }
}
