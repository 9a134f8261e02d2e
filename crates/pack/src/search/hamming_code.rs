//! Codes of descriptors in a list of an inverted file: one bit for each number of the rotated difference to the list's centroid
//! (Hamming embedding; Jégou, Douze and Schmid 2008). Few different bits mean similar descriptors.

use grimnet_kernels::PlainKernel;

/// Bits of a word of a code.
const WORD_BITS: usize = 64;

/// Of the rotation's signs: part of the pack format.
const SIGN_SEED: u64 = 1477;

/// Numbers of a rotated descriptor, which are as many as bits of its code: the next power of two, and a whole number of words.
pub(super) fn code_bits(dim: usize) -> usize {
    dim.next_power_of_two().max(WORD_BITS)
}

/// Words of a code.
pub fn code_words(dim: usize) -> usize {
    code_bits(dim) / WORD_BITS
}

/// Appends the signs of the rotated difference to the centroid. `rotated` is a buffer of [`code_bits`] numbers.
pub(super) fn push_code(
    descriptor: &[f32],
    centroid: &[f32],
    rotated: &mut [f32],
    codes: &mut Vec<u64>,
) {
    rotated.fill(0.0);
    for (out, (d, c)) in rotated.iter_mut().zip(descriptor.iter().zip(centroid)) {
        *out = d - c;
    }
    rotate(rotated);
    codes.extend(rotated.chunks_exact(WORD_BITS).map(|numbers| {
        numbers
            .iter()
            .enumerate()
            .fold(0, |word, (bit, &v)| word | u64::from(v > 0.0) << bit)
    }));
}

/// A fixed rotation (up to scale) of a power of two of numbers: signs, then the Hadamard transform, twice. It spreads what few numbers
/// of a descriptor say over all bits (Ailon and Chazelle 2006).
fn rotate(numbers: &mut [f32]) {
    for round in 0..2u64 {
        let mut state = SIGN_SEED + round;
        for v in numbers.iter_mut() {
            // The multiplicative generator of Knuth's MMIX.
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            if state >> 63 == 1 {
                *v = -*v;
            }
        }
        let mut half = 1;
        while half < numbers.len() {
            for pair in numbers.chunks_exact_mut(2 * half) {
                let (low, high) = pair.split_at_mut(half);
                for (a, b) in low.iter_mut().zip(high) {
                    (*a, *b) = (*a + *b, *a - *b);
                }
            }
            half *= 2;
        }
    }
}

/// Number of different bits of a code and each of several codes.
pub(super) struct HammingDistances<'a> {
    /// Code of a query.
    pub code: &'a [u64],
    /// Codes of as many keypoints as there are distances.
    pub codes: &'a [u64],
    /// Output, bits.
    pub distances: &'a mut [u16],
}

impl HammingDistances<'_> {
    #[inline(always)]
    fn of_words<const WORDS: usize>(self) {
        let (codes, _) = self.codes.as_chunks::<WORDS>();
        let code: [u64; WORDS] = std::array::from_fn(|i| self.code[i]);
        for (out, other) in self.distances.iter_mut().zip(codes) {
            *out = (0..WORDS)
                .map(|i| (code[i] ^ other[i]).count_ones() as u16)
                .sum();
        }
    }
}

impl PlainKernel for HammingDistances<'_> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        match self.code.len() {
            1 => self.of_words::<1>(),
            2 => self.of_words::<2>(),
            4 => self.of_words::<4>(),
            words => {
                for (out, other) in self
                    .distances
                    .iter_mut()
                    .zip(self.codes.chunks_exact(words))
                {
                    let differ = self.code.iter().zip(other).map(|(a, b)| a ^ b);
                    *out = differ.map(|word| word.count_ones() as u16).sum();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rotation_keeps_angles() {
        let cosine = |a: &[f32], b: &[f32]| -> f32 {
            let product =
                |a: &[f32], b: &[f32]| -> f32 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
            product(a, b) / (product(a, a) * product(b, b)).sqrt()
        };
        let mut a: [f32; 128] = std::array::from_fn(|i| (i as f32).sin());
        let mut b: [f32; 128] = std::array::from_fn(|i| (i as f32 + 1.0).sin());
        let plain = cosine(&a, &b);
        rotate(&mut a);
        rotate(&mut b);
        assert!(plain > 0.05 && (cosine(&a, &b) - plain).abs() < 1e-5);
    }
}
