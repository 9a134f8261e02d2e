//! Two hypotheses that say the same become one.

use std::cmp::Ordering;

use nalgebra::SVector;

use crate::hypothesis::Hypothesis;
use crate::kalman::POSITION;

impl Hypothesis {
    /// Whether the other hypothesis says the same: position and velocity are within one sigma, and neither is much less
    /// certain.
    pub fn agrees_with(&self, other: &Self) -> bool {
        if self.reference.kind != other.reference.kind || self.position_of != other.position_of {
            return false;
        }
        let (ours, theirs) = (
            self.position_covariance_m2().determinant(),
            other.position_covariance_m2().determinant(),
        );
        if ours.max(theirs).partial_cmp(&(4.0 * ours.min(theirs))) != Some(Ordering::Less) {
            return false;
        }
        let position = self.position_m() - other.position_m();
        let velocity = self.velocity_m_s() - other.velocity_m_s();
        let apart = SVector::<f64, 4>::new(position.x, position.y, velocity.x, velocity.y);
        let spread = self.covariance.fixed_view::<4, 4>(POSITION, POSITION)
            + other.covariance.fixed_view::<4, 4>(POSITION, POSITION);
        spread
            .cholesky()
            .is_some_and(|factor| apart.dot(&factor.solve(&apart)) < 1.0)
    }

    /// Merges a lighter hypothesis into this one: weight, mean and covariance of the two together are kept.
    pub fn absorb(&mut self, mut other: Self) {
        other.refer_to(self.reference.velocity_m_s);
        let weight = self.weight + other.weight;
        if weight <= 0.0 {
            return;
        }
        let share = other.weight / weight;
        let apart = other.mean - self.mean;
        self.covariance = self.covariance * (1.0 - share)
            + other.covariance * share
            + apart * apart.transpose() * (share * (1.0 - share));
        self.mean += apart * share;
        self.weight = weight;
        self.fixes = self.fixes.max(other.fixes);
    }
}
