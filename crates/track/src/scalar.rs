//! Scalar Kalman filters for heading and ground resolution.

use grimnet_geo::turn_deg;

/// A heading and its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HeadingFilter {
    /// Degrees clockwise from true north in `[0, 360)`.
    pub heading_deg: f64,
    /// Square degrees.
    pub variance_deg2: f64,
}

/// What is measured and off by more standard deviations than this shows that the turns or climbs since the last time were not what was
/// reported: 99.99 % of a normal distribution lie within.
const MOST_SIGMAS: f64 = 3.9;
/// Above this the heading is unknown: a uniform heading has 104 degrees.
const UNKNOWN_HEADING_DEG: f64 = 104.0;

impl HeadingFilter {
    /// A heading with its standard deviation.
    pub fn new(heading_deg: f64, sigma_deg: f64) -> Self {
        Self {
            heading_deg: heading_deg.rem_euclid(360.0),
            variance_deg2: sigma_deg * sigma_deg,
        }
    }

    /// Turns by `turn_deg` with an error of `sigma_deg`.
    pub fn turn(&mut self, turn_deg: f64, sigma_deg: f64) {
        self.heading_deg = (self.heading_deg + turn_deg).rem_euclid(360.0);
        self.variance_deg2 =
            (self.variance_deg2 + sigma_deg * sigma_deg).min(UNKNOWN_HEADING_DEG.powi(2));
    }

    /// Takes in a measured heading. One that contradicts this one replaces it: a yaw that was reset in flight looks like a turn.
    pub fn update(&mut self, measured_deg: f64, sigma_deg: f64) {
        let innovation_deg = turn_deg(self.heading_deg, measured_deg);
        if innovation_deg.abs() > MOST_SIGMAS * self.sigma_deg().hypot(sigma_deg) {
            *self = Self::new(measured_deg, sigma_deg);
            return;
        }
        let gain = self.variance_deg2 / (self.variance_deg2 + sigma_deg * sigma_deg);
        self.heading_deg = (self.heading_deg + gain * innovation_deg).rem_euclid(360.0);
        self.variance_deg2 *= 1.0 - gain;
    }

    /// Standard deviation, degrees.
    pub fn sigma_deg(&self) -> f64 {
        self.variance_deg2.sqrt()
    }
}

/// The logarithm of the ground resolution and its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct GsdFilter {
    /// Natural logarithm of metres per pixel.
    pub ln_gsd: f64,
    /// Variance of it.
    pub variance: f64,
}

impl GsdFilter {
    /// A ground resolution with its relative standard deviation.
    pub fn new(gsd_m: f64, sigma: f64) -> Self {
        Self {
            ln_gsd: gsd_m.ln(),
            variance: sigma * sigma,
        }
    }

    /// Metres per pixel.
    pub fn gsd_m(&self) -> f64 {
        self.ln_gsd.exp()
    }

    /// The height changes by a factor with a relative error.
    pub fn scale(&mut self, factor: f64, sigma: f64) {
        self.ln_gsd += factor.ln();
        self.spread(sigma * sigma);
    }

    /// It becomes less certain.
    pub fn spread(&mut self, variance: f64) {
        // A factor of e is as good as unknown.
        self.variance = (self.variance + variance).min(1.0);
    }

    /// Takes in a measured ground resolution. One that is far from what was known is of another surface, such as behind a cliff: what
    /// was known says nothing of that.
    pub fn update(&mut self, gsd_m: f64, sigma: f64) {
        let off = (gsd_m.ln() - self.ln_gsd).abs();
        if off > MOST_SIGMAS * self.variance.sqrt().hypot(sigma) {
            *self = Self::new(gsd_m, sigma);
            return;
        }
        let gain = self.variance / (self.variance + sigma * sigma);
        self.ln_gsd += gain * (gsd_m.ln() - self.ln_gsd);
        self.variance *= 1.0 - gain;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn headings_meet_across_north() {
        let mut filter = HeadingFilter::new(359.0, 2.0);
        filter.update(3.0, 2.0);
        assert_relative_eq!(filter.heading_deg, 1.0, epsilon = 1e-9);
        assert_relative_eq!(filter.sigma_deg(), 2f64.sqrt(), epsilon = 1e-9);
        filter.turn(-2.0, 1.0);
        assert_relative_eq!(filter.heading_deg, 359.0, epsilon = 1e-9);
    }

    #[test]
    fn a_heading_that_is_contradicted_is_replaced() {
        let mut filter = HeadingFilter::new(210.0, 10.0);
        filter.update(245.0, 1.5);
        assert!((244.0..245.0).contains(&filter.heading_deg), "{filter:?}");
        filter.turn(120.0, 8.0);
        filter.update(246.0, 1.5);
        assert_relative_eq!(filter.heading_deg, 246.0);
        assert_relative_eq!(filter.sigma_deg(), 1.5);
    }

    #[test]
    fn ground_resolutions_average_as_ratios() {
        let mut filter = GsdFilter::new(0.04, 0.2);
        filter.update(0.09, 0.2);
        assert_relative_eq!(filter.gsd_m(), 0.06, epsilon = 1e-12);
        filter.scale(2.0, 0.0);
        assert_relative_eq!(filter.gsd_m(), 0.12, epsilon = 1e-12);
        // Of another surface.
        let mut filter = GsdFilter::new(0.04, 0.02);
        filter.update(0.08, 0.02);
        assert_eq!(filter, GsdFilter::new(0.08, 0.02));
    }
}
