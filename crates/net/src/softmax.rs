//! Exponential function and softmax, written so that the compiler can vectorise them.

/// Values that are processed together: a multiple of the lanes of every instruction set.
const LANES: usize = 16;

/// Replaces each value by exp(v) divided by the sum over all values.
#[inline(always)]
pub(crate) fn softmax(values: &mut [f32]) {
    let (chunks, rest) = values.as_chunks_mut::<LANES>();
    let mut largest = [f32::MIN; LANES];
    for chunk in chunks.iter() {
        for (m, &v) in largest.iter_mut().zip(chunk) {
            *m = if v > *m { v } else { *m };
        }
    }
    let largest = largest
        .iter()
        .chain(rest.iter())
        .copied()
        .fold(f32::MIN, f32::max);
    let mut sums = [0.0f32; LANES];
    for chunk in chunks.iter_mut() {
        for (v, sum) in chunk.iter_mut().zip(&mut sums) {
            *v = exp(*v - largest);
            *sum += *v;
        }
    }
    let mut sum: f32 = sums.iter().sum();
    for v in rest {
        *v = exp(*v - largest);
        sum += *v;
    }
    let factor = 1.0 / sum;
    values.iter_mut().for_each(|v| *v *= factor);
}

/// e^x for x in -87..=88 (e^-87 for smaller x), relative error below 2e-7. Cody-Waite reduction and the minimax polynomial
/// of `expf` in Cephes (Moshier 1989); no branches and no calls.
#[inline(always)]
fn exp(x: f32) -> f32 {
    // Adding 1.5 * 2^23 rounds to an integer, which is then in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.max(-87.0);
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = x - n * LN2_HIGH - n * LN2_LOW;
    let p = 1.987_569_1e-4;
    let p = p * r + 1.398_199_9e-3;
    let p = p * r + 8.333_452e-3;
    let p = p * r + 4.166_579_6e-2;
    let p = p * r + 1.666_666_5e-1;
    let p = p * r + 0.5;
    let p = p * r * r + r + 1.0;
    p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0f32.to_bits()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_is_exact_to_single_precision() {
        for i in -8700..=100 {
            let x = i as f32 / 100.0;
            let exact = f64::from(x).exp();
            assert!((f64::from(exp(x)) / exact - 1.0).abs() < 2e-7, "{x}");
        }
        assert!(exp(-1e30) > 0.0 && exp(f32::MIN) < 1e-37);
    }

    #[test]
    fn softmax_sums_to_one_whatever_the_length() {
        for len in [1, 6, 16, 64, 65] {
            let logits: Vec<f32> = (0..len).map(|i| ((i * 7) % 11) as f32 * 9.0).collect();
            let total: f64 = logits.iter().map(|&v| (f64::from(v) - 90.0).exp()).sum();
            let mut values = logits.clone();
            softmax(&mut values);
            for (p, v) in values.iter().zip(&logits) {
                let exact = (f64::from(*v) - 90.0).exp() / total;
                assert!((f64::from(*p) - exact).abs() < 1e-6, "{len}");
            }
        }
    }
}
