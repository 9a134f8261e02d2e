//! Which of the candidates matched in full wins, and by how much.

use nalgebra::Vector2;

use crate::{
    attempt::Tried,
    gates::Rejection,
    options::{Choice, Options},
    verify::Verified,
};

/// Two answers closer than this are of the same place, pixels of the level.
const SAME_PLACE_PX: f64 = 32.0;

/// The best answer of one round.
pub(crate) struct Best<'a> {
    pub tried: &'a Tried,
    pub verified: &'a Verified,
    pub runner_up: Option<&'a Verified>,
    pub rejection: Option<Rejection>,
}

impl<'a> Best<'a> {
    /// The best of a round and its runner-up; none where nothing was matched.
    pub fn of(tried: &'a Tried, options: &Options) -> Option<Self> {
        let (verified, runner_up) = best_among(&tried.verified, options)?;
        Some(Self {
            tried,
            verified,
            runner_up,
            rejection: verified
                .rejection
                .or_else(|| margin_rejection(verified, runner_up, options)),
        })
    }

    /// Whether no further round is worth its time.
    pub fn is_clear(&self, options: &Options) -> bool {
        is_clear(self.verified, self.runner_up, options)
    }

    /// The same place matched again, `again`, where that holds and says no less; else this. The runner-up stays: the second look is
    /// at one place.
    pub fn or_again(self, again: Option<Self>, options: &Options) -> Self {
        let worth = |again: &Self| {
            again.verified.rejection.is_none()
                && same_place(again.verified, self.verified)
                && (self.rejection.is_some()
                    || again.verified.inliers.len() >= self.verified.inliers.len())
        };
        let Some(again) = again.filter(worth) else {
            return self;
        };
        let rejection = margin_rejection(again.verified, self.runner_up, options);
        if rejection.is_some() && self.rejection.is_none() {
            return self;
        }
        Self {
            runner_up: self.runner_up,
            rejection,
            ..again
        }
    }

    /// What better answers have more of: passing the gates, then inliers.
    pub fn rank(&self) -> (bool, usize) {
        (self.rejection.is_none(), self.verified.inliers.len())
    }
}

/// Inliers of the best answer at another place.
pub(crate) fn runner_up_inliers(runner_up: Option<&Verified>) -> usize {
    runner_up.map_or(0, |other| other.inliers.len())
}

/// Whether the gate on the margin over the runner-up refuses.
fn margin_rejection(
    best: &Verified,
    runner_up: Option<&Verified>,
    options: &Options,
) -> Option<Rejection> {
    options
        .gates?
        .check_margin(best.inliers.len(), runner_up_inliers(runner_up))
        .err()
}

/// Whether no further candidate is worth its time.
pub(crate) fn is_clear(best: &Verified, runner_up: Option<&Verified>, options: &Options) -> bool {
    // Twice the runner-up: more candidates may follow that are better than any so far.
    best.rejection.is_none()
        && best.inliers.len() >= options.clear_inliers
        && best.inliers.len() >= 2 * runner_up_inliers(runner_up)
}

/// The best answer and the best at another place. Answers that pass the gates come first.
pub(crate) fn best_among<'a>(
    verified: &'a [Verified],
    options: &Options,
) -> Option<(&'a Verified, Option<&'a Verified>)> {
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
