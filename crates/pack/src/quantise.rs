//! Unit vectors as signed bytes.
//!
//! Local descriptors share one scale per dimension, so that integer products of any two can be compared
//! without rescaling: entries of a unit vector of dimension `D` have a root mean square of `1/sqrt(D)`, and
//! [`DESCRIPTOR_RANGE`] times that maps to 127 (larger entries saturate). Tile descriptors get one scale per row.

/// Largest representable entry of a local descriptor, in units of `1/sqrt(dim)`.
pub const DESCRIPTOR_RANGE: f32 = 4.0;

/// The int8 quantisation scale of local descriptors of `dim` numbers: the value of one step.
pub fn descriptor_scale(dim: usize) -> f32 {
    DESCRIPTOR_RANGE / (127.0 * (dim.max(1) as f32).sqrt())
}

/// Quantises local descriptors (`n x dim`, unit rows) to int8 with the scale [`descriptor_scale`].
///
/// The cosine of two of them is their integer product times the square of the scale.
pub fn quantise_descriptors(descriptors: &[f32], dim: usize) -> Vec<i8> {
    let steps = 1.0 / descriptor_scale(dim);
    descriptors.iter().map(|&x| step(x * steps)).collect()
}

/// Quantises one vector so that its largest entry becomes 127.
///
/// Returns the bytes and the quantisation scale (0 for a zero vector). The scale is chosen so that the length is kept
/// exactly: products of quantised unit vectors are cosines, and no vector is more similar to a vector than itself.
pub fn quantise_row(row: &[f32]) -> (Vec<i8>, f32) {
    let largest = row.iter().fold(0.0f32, |m, x| m.max(x.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return (vec![0; row.len()], 0.0);
    }
    let steps = 127.0 / largest;
    let bytes: Vec<i8> = row.iter().map(|&x| step(x * steps)).collect();
    let known = row.iter().filter(|x| !x.is_nan());
    let length: f64 = known.map(|&x| f64::from(x) * f64::from(x)).sum();
    let steps_length: i64 = bytes.iter().map(|&b| i64::from(b) * i64::from(b)).sum();
    (bytes, (length / steps_length as f64).sqrt() as f32)
}

/// Nearest byte, symmetric and saturating; NaN becomes 0.
fn step(x: f32) -> i8 {
    x.round().clamp(-127.0, 127.0) as i8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn row_keeps_direction() {
        let row = [0.6f32, -0.8, 0.0];
        let (q, scale) = quantise_row(&row);
        assert_eq!(q, [95, -127, 0]);
        for (a, b) in row.iter().zip(&q) {
            assert!((a - f32::from(*b) * scale).abs() <= scale / 2.0);
        }
        assert_eq!(quantise_row(&[0.0, 0.0]), (vec![0, 0], 0.0));
        assert_eq!(quantise_row(&[f32::NAN, 1.0]).0, [0, 127]);
    }

    #[test]
    fn descriptors_saturate_at_the_range() {
        let dim = 4;
        let q = quantise_descriptors(&[3.0, -3.0, 0.5, 0.0], dim);
        assert_eq!(q, [127, -127, 32, 0]);
    }
}
