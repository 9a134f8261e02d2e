//! Headings, degrees clockwise from true north.

use crate::metres::wrap_longitude_deg;

/// The turn from one heading to another, degrees clockwise in `[-180, 180)`. The headings may be of any number of full turns; NaN and
/// infinities give NaN.
///
/// ```
/// use grimnet_geo::turn_deg;
/// assert_eq!(turn_deg(350.0, 10.0), 20.0);
/// assert_eq!(turn_deg(10.0, 350.0), -20.0);
/// assert_eq!(turn_deg(0.0, 180.0), -180.0);
/// ```
pub fn turn_deg(from_deg: f64, to_deg: f64) -> f64 {
    // The range of longitudes is that of turns.
    wrap_longitude_deg(to_deg - from_deg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_turn_leads_from_one_heading_to_the_other(from_deg in -1000.0..1000.0, to_deg in -1000.0..1000.0) {
            let turn = turn_deg(from_deg, to_deg);
            prop_assert!((-180.0..180.0).contains(&turn), "{turn}");
            let turns = (from_deg + turn - to_deg) / 360.0;
            prop_assert!((turns - turns.round()).abs() < 1e-9, "{from_deg} + {turn} is not {to_deg}");
        }
    }

    #[test]
    fn rounding_does_not_leave_the_range() {
        for from_deg in [180.0, 540.0, -180.0 + 1e-15, 180.0 + 1e-14, 1e300] {
            let turn = turn_deg(from_deg, 0.0);
            assert!((-180.0..180.0).contains(&turn), "{from_deg}: {turn}");
        }
        assert!(turn_deg(f64::NAN, 0.0).is_nan());
        assert!(turn_deg(0.0, f64::INFINITY).is_nan());
    }
}
