//! A first-order Gauss-Markov process and its integral.

use nalgebra::Matrix2;

/// A scalar that decays to zero with a correlation time and is kept at its standard deviation by white noise, and the integral
/// of it: the model of a velocity, or of a velocity's error, and of the position it leads to.
///
/// Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), section 8.2; Gelb,
/// "Applied Optimal Estimation" (1974), section 3.6.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GaussMarkov {
    /// Standard deviation that the process returns to.
    pub sigma: f64,
    /// Correlation time, seconds.
    pub correlation_s: f64,
}

/// One step of a [`GaussMarkov`] process and its integral.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// What of the value remains.
    pub decay: f64,
    /// What the integral gains for one unit of the value, seconds.
    pub gain_s: f64,
    /// Covariance that is added: integral, value.
    pub noise: Matrix2<f64>,
}

impl GaussMarkov {
    /// The process over `dt_s` seconds, which is not negative.
    pub fn step(&self, dt_s: f64) -> Step {
        let Self {
            sigma,
            correlation_s,
        } = *self;
        let ratio = dt_s / correlation_s;
        // 1 - exp(-ratio), exact for small ratios.
        let lost = -(-ratio).exp_m1();
        let variance = sigma * sigma;
        let value = variance * lost * (2.0 - lost);
        let cross = variance * correlation_s * lost * lost;
        // 2 r - 3 + 4 exp(-r) - exp(-2 r) loses all digits for small r, where it is 2/3 r^3 - 1/2 r^4.
        let shape = if ratio < 1e-3 {
            ratio.powi(3) * (2.0 / 3.0 - 0.5 * ratio)
        } else {
            2.0 * ratio - 2.0 * lost - lost * lost
        };
        let integral = variance * correlation_s * correlation_s * shape;
        Step {
            decay: 1.0 - lost,
            gain_s: correlation_s * lost,
            noise: Matrix2::new(integral, cross, cross, value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn two_half_steps_are_one_step() {
        let process = GaussMarkov {
            sigma: 0.3,
            correlation_s: 60.0,
        };
        for dt_s in [1e-3, 0.05, 0.1, 1.0, 30.0, 300.0] {
            let (half, whole) = (process.step(0.5 * dt_s), process.step(dt_s));
            let transition = Matrix2::new(1.0, half.gain_s, 0.0, half.decay);
            let twice = transition * half.noise * transition.transpose() + half.noise;
            assert_relative_eq!(twice, whole.noise, max_relative = 1e-5);
            assert_relative_eq!(half.decay * half.decay, whole.decay, max_relative = 1e-12);
        }
    }

    #[test]
    fn a_long_correlation_is_a_white_acceleration() {
        // q = 2 sigma^2 / tau; noise of the double integral q dt^3 / 3.
        let process = GaussMarkov {
            sigma: 100.0,
            correlation_s: 5000.0,
        };
        let (q, dt_s) = (4.0, 2.0);
        let noise = process.step(dt_s).noise;
        assert_relative_eq!(
            noise[(0, 0)],
            q * dt_s * dt_s * dt_s / 3.0,
            max_relative = 1e-3
        );
        assert_relative_eq!(noise[(0, 1)], q * dt_s * dt_s / 2.0, max_relative = 1e-3);
        assert_relative_eq!(noise[(1, 1)], q * dt_s, max_relative = 1e-3);
    }
}
