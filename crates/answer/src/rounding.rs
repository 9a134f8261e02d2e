//! Numbers with as many digits as they are worth.

/// Rounds to `decimals`: 8 decimals of a degree are a millimetre. Zero has no sign.
pub fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let scaled = value * scale;
    if scaled.is_infinite() {
        // So large a number has no decimals.
        return value;
    }
    scaled.round() / scale + 0.0
}

/// A heading from 0 to below 360 degrees, rounded to so many decimals: 359.999 to 0.
pub fn rounded_heading(heading_deg: f64, decimals: i32) -> f64 {
    rounded(heading_deg, decimals) % 360.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_has_no_sign() {
        assert!(rounded(-0.004, 2).is_sign_positive());
        assert_eq!(rounded(-0.006, 2), -0.01);
    }

    #[test]
    fn numbers_too_large_to_have_decimals_stay_what_they_are() {
        assert_eq!(rounded(1e305, 6), 1e305);
        assert_eq!(rounded(-f64::MAX, 8), -f64::MAX);
        assert!(rounded_heading(-1e308, 1).is_finite());
    }

    #[test]
    fn a_heading_stays_below_a_full_turn() {
        let rounded = [0.0, 152.104, 359.994, 359.996].map(|deg| rounded_heading(deg, 2));
        assert_eq!(rounded, [0.0, 152.1, 359.99, 0.0]);
    }
}
