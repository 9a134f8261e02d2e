//! The order in which RANSAC draws samples.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The order in which samples are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// The best matches first, see [`Progressive`].
    Progressive,
    /// All matches alike, see [`Uniform`].
    Uniform,
}

impl Sampling {
    /// A sampler with this seed.
    pub fn sampler(self, seed: u64) -> Box<dyn Sampler> {
        match self {
            Self::Progressive => Box::new(Progressive::new(seed)),
            Self::Uniform => Box::new(Uniform::new(seed)),
        }
    }
}

/// Draws samples of distinct indices.
pub trait Sampler {
    /// Fills `sample` with distinct indices below `count`, which is at least `sample.len()` and the same at every call.
    fn draw(&mut self, count: usize, sample: &mut [usize]);
}

/// Uniform sampling.
#[derive(Debug, Clone)]
pub struct Uniform {
    rng: ChaCha8Rng,
}

impl Uniform {
    /// A sampler with this seed. The same seed gives the same sequence.
    pub fn new(seed: u64) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }
}

impl Sampler for Uniform {
    fn draw(&mut self, count: usize, sample: &mut [usize]) {
        draw_distinct(&mut self.rng, count, sample);
    }
}

/// Progressive sampling: the best matches first, all of them in the end (PROSAC, Chum & Matas 2005). Pairs must be sorted by
/// falling quality.
#[derive(Debug, Clone)]
pub struct Progressive {
    rng: ChaCha8Rng,
    pool: usize,
    drawn: usize,
    /// Expected number of samples from the present pool among [`PROSAC_SAMPLES`] uniform samples.
    expected: f64,
    /// Number of samples after which the pool grows.
    grow_at: usize,
}

/// Number of samples after which PROSAC becomes uniform sampling (T_N in the publication).
const PROSAC_SAMPLES: f64 = 10_000.0;

impl Progressive {
    /// A sampler with this seed. The same seed gives the same sequence.
    pub fn new(seed: u64) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            pool: 0,
            drawn: 0,
            expected: 0.0,
            grow_at: 0,
        }
    }
}

impl Sampler for Progressive {
    fn draw(&mut self, count: usize, sample: &mut [usize]) {
        let size = sample.len();
        if self.pool == 0 {
            self.pool = size.min(count);
            self.expected = (0..size).fold(PROSAC_SAMPLES, |t, i| {
                t * (size - i) as f64 / (count - i) as f64
            });
            self.grow_at = 1;
        }
        self.drawn += 1;
        while self.drawn > self.grow_at && self.pool < count {
            let next = self.expected * (self.pool + 1) as f64 / (self.pool + 1 - size) as f64;
            self.grow_at += (next - self.expected).ceil().max(1.0) as usize;
            self.expected = next;
            self.pool += 1;
        }
        if self.pool == count || self.pool <= size {
            draw_distinct(&mut self.rng, self.pool, sample);
        } else {
            // The newest member of the pool with others before it, so that samples of the smaller pool are not repeated.
            let (last, others) = (size - 1, self.pool - 1);
            draw_distinct(&mut self.rng, others, &mut sample[..last]);
            sample[last] = others;
        }
    }
}

fn draw_distinct(rng: &mut ChaCha8Rng, count: usize, sample: &mut [usize]) {
    for at in 0..sample.len() {
        sample[at] = loop {
            let index = rng.random_range(0..count);
            if !sample[..at].contains(&index) {
                break index;
            }
        };
    }
}
