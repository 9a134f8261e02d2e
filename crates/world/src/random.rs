//! Seeded randomness: integer hashes for shading (same place, same value) and a stream for
//! generation (SplitMix64, Steele et al. 2014).

/// Mixes 32 bits (constants of "lowbias32", Wellons 2018).
#[inline]
pub(crate) fn hash32(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Mixes two words.
#[inline]
pub(crate) fn hash2(a: u32, b: u32) -> u32 {
    hash32(a.wrapping_mul(0x9e37_79b1) ^ hash32(b))
}

/// Mixes a seed with an integer lattice point.
#[inline]
pub(crate) fn hash_cell(seed: u32, x: i32, y: i32) -> u32 {
    hash32(
        seed ^ (x as u32).wrapping_mul(0x9e37_79b1) ^ hash32((y as u32).wrapping_mul(0x85eb_ca6b)),
    )
}

/// Uniform in `[0, 1)` from the upper 24 bits of a hash.
#[inline]
pub(crate) fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A stream of random numbers for generation.
#[derive(Clone, Debug)]
pub(crate) struct Stream(u64);

impl Stream {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed ^ 0x5851_f42d_4c95_7f2d)
    }

    /// An independent stream, so that one part's draws do not shift another's.
    pub(crate) fn fork(&mut self, tag: u64) -> Self {
        Self(self.next_u64() ^ tag.wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub(crate) fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }

    /// Uniform in `[0, 1)`.
    pub(crate) fn unit(&mut self) -> f32 {
        unit(self.next_u32())
    }

    /// Uniform in `[low, high)`.
    pub(crate) fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    /// Uniform in `0..n`; 0 for `n = 0`.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n.saturating_sub(1))
    }

    /// An element of a non-empty slice.
    pub(crate) fn pick<T: Copy>(&mut self, items: &[T]) -> T {
        items[self.below(items.len())]
    }

    /// About normal with mean 0 and deviation 1 (sum of four uniforms).
    pub(crate) fn normal(&mut self) -> f32 {
        (self.unit() + self.unit() + self.unit() + self.unit() - 2.0) * 1.732
    }
}
