//! How the height above ground changes between two reported heights.

use crate::input::Height;

/// No aircraft that this filter is for climbs or descends faster, metres per second: a multirotor reaches 5 to 10, a small plane in a dive
/// 20.
const MOST_CLIMB_M_S: f64 = 20.0;
/// A step of up to so much besides is noise of the height, metres: barometers in gusts and rangefinders over roofs and trees.
const NOISE_M: f64 = 5.0;
/// Heights of another reference that last no longer are outliers, seconds: a rangefinder over a roof, a beam that is lost for a moment.
const SOON_S: f64 = 10.0;
/// Climb rate where no height tells it, metres per second, 1 sigma.
const UNKNOWN_CLIMB_SIGMA_M_S: f64 = 5.0;
/// Error of a reported climb relative to the logarithm of its factor, 1 sigma.
const CLIMB_SIGMA: f64 = 0.1;

/// A change of the height above ground, which changes the ground resolution by the same factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Climb {
    /// Height afterwards over height before.
    pub factor: f64,
    /// Its relative error, 1 sigma.
    pub sigma: f64,
    /// By how much the height rose only because its reference is another one, metres. `None` if both have the same.
    pub reference_step_m: Option<f64>,
}

impl Climb {
    /// The climb between two heights that were reported one after the other.
    ///
    /// Heights that differ by more than any aircraft climbs have different references: above the home position, above the ground that
    /// a rangefinder measures, or of another pressure. They tell nothing of the climb, so the height stays as it was but for what the
    /// aircraft may have climbed in the meantime. The first one was measured at `measured_s`, maybe before it was reported.
    pub fn between(before: &Height, measured_s: f64, after: &Height) -> Self {
        let step_m = after.agl_m - before.agl_m;
        if step_m.abs() > MOST_CLIMB_M_S * (after.time_s - measured_s) + NOISE_M {
            let interval_s = after.time_s - before.time_s;
            // Either height may be the right one.
            let lowest_m = before.agl_m.min(after.agl_m);
            return Self {
                factor: 1.0,
                sigma: UNKNOWN_CLIMB_SIGMA_M_S * interval_s / lowest_m,
                reference_step_m: Some(step_m),
            };
        }
        let factor = after.agl_m / before.agl_m;
        Self {
            factor,
            sigma: CLIMB_SIGMA * factor.ln().abs(),
            reference_step_m: None,
        }
    }
}

/// A step of the reference of heights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ReferenceStep {
    /// Seconds.
    time_s: f64,
    /// By how much heights rose with it, metres. Those before and those after it may be the ones above the ground below.
    pub by_m: f64,
}

impl ReferenceStep {
    /// The last step after one more at `time_s`. One that leads back soon says that it was the heights in between that were wrong.
    pub fn next(before: Option<Self>, time_s: f64, by_m: f64) -> Option<Self> {
        let leads_back = before.is_some_and(|before| {
            time_s - before.time_s <= SOON_S && (before.by_m + by_m).abs() <= NOISE_M
        });
        (!leads_back).then_some(Self { time_s, by_m })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn climb(after_s: f64, [before_m, after_m]: [f64; 2]) -> Climb {
        let height = |time_s, agl_m| Height {
            time_s,
            agl_m,
            amsl_m: None,
        };
        Climb::between(&height(7.0, before_m), 7.0, &height(7.0 + after_s, after_m))
    }

    #[test]
    fn what_an_aircraft_can_climb_is_a_climb() {
        assert_eq!(climb(0.2, [100.0, 108.0]).factor, 1.08);
        assert_eq!(climb(3.0, [100.0, 40.0]).factor, 0.4);
        assert_eq!(climb(0.0, [100.0, 104.0]).factor, 1.04);
        assert!(climb(0.2, [100.0, 108.0]).sigma < 0.01);
    }

    #[test]
    fn a_faster_step_is_another_reference_and_leaves_the_height_as_uncertain_as_an_unknown_climb() {
        for heights_m in [[115.0, 60.0], [60.0, 115.0]] {
            let step = climb(0.5, heights_m);
            assert_eq!(step.factor, 1.0);
            assert_eq!(step.reference_step_m, Some(heights_m[1] - heights_m[0]));
            // 2.5 m of 60 m.
            assert!((step.sigma - 0.0417).abs() < 1e-4, "{step:?}");
        }
    }

    #[test]
    fn a_step_that_leads_back_soon_leaves_no_doubt() {
        for (lasted_s, back_m, left_m) in [
            (4.0, -54.0, None),
            (4.0, -20.0, Some(-20.0)),
            (4.0, 55.0, Some(55.0)),
            (30.0, -55.0, Some(-55.0)),
        ] {
            let step = ReferenceStep::next(None, 7.0, 55.0);
            assert_eq!(step.map(|step| step.by_m), Some(55.0));
            let step = ReferenceStep::next(step, 7.0 + lasted_s, back_m);
            assert_eq!(
                step.map(|step| step.by_m),
                left_m,
                "{lasted_s} s, {back_m} m"
            );
        }
    }
}
