//! Numbers with as many digits as they are worth.

/// Rounds to `decimals`: 8 decimals of a degree are a millimetre.
pub fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    (value * scale).round() / scale
}
