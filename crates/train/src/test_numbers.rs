//! Random numbers for tests, the same in every run; burn's random tensors are not.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use std::ops::Range;

/// `len` uniform random numbers of a range.
pub(crate) fn uniform(len: usize, range: Range<f32>, seed: u64) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..len)
        .map(|_| random.random_range(range.clone()))
        .collect()
}
