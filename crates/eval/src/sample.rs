//! Statistics of a sample: percentiles, and how sure they are.

use rand::{Rng, SeedableRng};

/// Share of values at most `limit`; zero of nothing.
#[must_use]
pub fn share_within(values: &[f64], limit: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.iter().filter(|v| **v <= limit).count() as f64 / values.len() as f64
}

/// Mean; none of nothing.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The value below which a share `q` of the values lies (linear interpolation, as numpy's default);
/// none where it is not finite.
#[must_use]
pub fn percentile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let position = q * last as f64;
    let (low, high) = (
        sorted[position.floor() as usize],
        sorted[position.ceil() as usize],
    );
    let value = if low == high {
        low
    } else {
        low + (high - low) * position.fract()
    };
    value.is_finite().then_some(value)
}

/// 95 % percentile bootstrap interval (Efron 1979) of a figure, 1,000 resamples, fixed seed. An end is infinite
/// where the figure is.
#[must_use]
pub fn bootstrap_interval(values: &[f64], figure: impl Fn(&[f64]) -> f64) -> [f64; 2] {
    if values.is_empty() {
        return [0.0, 0.0];
    }
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1979);
    let mut sample = values.to_vec();
    let figures: Vec<f64> = (0..1000)
        .map(|_| {
            for slot in &mut sample {
                *slot = values[rng.random_range(0..values.len())];
            }
            figure(&sample)
        })
        .collect();
    [0.025, 0.975].map(|q| percentile(&figures, q).unwrap_or(f64::INFINITY))
}
