//! Random numbers and slowly changing errors.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// How confident wrong fixes are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Confidence {
    /// A confidence of 0.8 is right in 80 % of all fixes.
    Calibrated,
    /// Wrong fixes are as confident as right ones.
    Hostile,
}

/// A standard normal number (Box and Muller 1958).
pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (1.0 - rng.random::<f64>(), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// A first-order Gauss-Markov error.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drift {
    sigma: f64,
    correlation_s: f64,
    pub value: f64,
}

impl Drift {
    pub fn new(sigma: f64, correlation_s: f64, rng: &mut ChaCha8Rng) -> Self {
        Self {
            sigma,
            correlation_s,
            value: sigma * normal(rng),
        }
    }

    pub fn step(&mut self, dt_s: f64, rng: &mut ChaCha8Rng) -> f64 {
        let decay = (-dt_s / self.correlation_s).exp();
        self.value = self.value * decay + self.sigma * (1.0 - decay * decay).sqrt() * normal(rng);
        self.value
    }
}

/// The confidence of [`Confidence::Calibrated`] for a score, where `share_wrong` of all fixes are wrong.
///
/// A score is normal with means that are `2 * SEPARATION` apart for right and wrong fixes; its log likelihood ratio and the
/// share of wrong fixes give the confidence by Bayes' rule.
pub(super) fn confidence(score: f64, share_wrong: f64) -> f64 {
    let prior = ((1.0 - share_wrong) / share_wrong).ln();
    1.0 / (1.0 + (-(2.0 * SEPARATION * score + prior)).exp())
}

/// Half the distance between the mean scores of right and wrong fixes, in standard deviations.
pub(super) const SEPARATION: f64 = 1.2;
