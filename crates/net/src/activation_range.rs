//! The ranges of activations, from the statistics that normalise them.
//!
//! After DA-BN a channel has the affine parameters as moments: mean beta and standard deviation |gamma| (Nagel et al. 2019,
//! "Data-free quantization through weight equalization and bias correction"). So no pictures are needed, and the ranges follow
//! statistics that are adapted to a map or a flight.

use grimnet_kernels::ByteScale;

use crate::NetError;
use crate::layer::LayerSource;

/// Standard deviations above the mean that bytes of a normalised channel reach.
const DEVIATIONS: f32 = 8.0;
/// The same for sums of channels, whose deviations are computed as if the channels were independent.
const SUM_DEVIATIONS: f32 = 12.0;
/// Smallest range, relative to other numbers of a trained network: a channel that is always zero.
const SMALLEST_RANGE: f32 = 1e-6;

/// What the bytes of a layer after DA-BN and ReLU stand for.
pub(crate) fn rectified(source: &LayerSource, name: &str) -> Result<ByteScale, NetError> {
    Ok(ByteScale::unsigned(&largest(source, name)?))
}

fn largest(source: &LayerSource, name: &str) -> Result<Vec<f32>, NetError> {
    let (gamma, beta, _) = source.norm(name)?;
    let limit = |(gamma, beta): (&f32, &f32)| {
        let deviation = gamma.abs();
        (beta + DEVIATIONS * deviation)
            .max(deviation)
            .max(SMALLEST_RANGE)
    };
    Ok(gamma.iter().zip(&beta).map(limit).collect())
}

/// What the bytes of the sum of a rectified layer and of 1 x 1 convolutions of others stand for; `laterals` are the names of the
/// convolutions and of their inputs.
pub(crate) fn sum_of_rectified(
    source: &LayerSource,
    name: &str,
    laterals: [(&str, &String); 2],
) -> Result<ByteScale, NetError> {
    let mut largest = largest(source, name)?;
    let channels = largest.len();
    let (mut mean, mut variance) = (vec![0.0; channels], vec![0.0; channels]);
    for (lateral, input) in laterals {
        let part = |part: &str| source.model.values(&format!("{lateral}.{part}"));
        let (weight, bias) = (part("weight")?, part("bias")?);
        let (gamma, beta, _) = source.norm(input)?;
        let moments: Vec<(f32, f32)> = gamma
            .iter()
            .zip(&beta)
            .map(|(gamma, beta)| rectified_moments(*beta, gamma.abs()))
            .collect();
        for (o, row) in weight.chunks_exact(moments.len().max(1)).enumerate() {
            mean[o] += bias[o];
            for (w, (m, v)) in row.iter().zip(&moments) {
                mean[o] += w * m;
                variance[o] += w * w * v;
            }
        }
    }
    let mut smallest = vec![0.0; channels];
    for (o, (low, high)) in smallest.iter_mut().zip(&mut largest).enumerate() {
        let deviation = SUM_DEVIATIONS * variance[o].sqrt();
        *low = (mean[o] - deviation).min(0.0);
        *high = (*high + mean[o] + deviation).max(SMALLEST_RANGE);
    }
    Ok(ByteScale::signed(&smallest, &largest))
}

/// Mean and variance of `max(x, 0)` for a normally distributed `x`.
fn rectified_moments(mean: f32, deviation: f32) -> (f32, f32) {
    // The midpoint rule over four deviations on both sides.
    const STEPS: usize = 64;
    let (mut weight, mut first, mut second) = (0.0f32, 0.0f32, 0.0f32);
    for i in 0..STEPS {
        let z = (i as f32 + 0.5) * (8.0 / STEPS as f32) - 4.0;
        let (density, value) = ((-0.5 * z * z).exp(), (mean + z * deviation).max(0.0));
        weight += density;
        first += density * value;
        second += density * value * value;
    }
    let mean = first / weight;
    (mean, (second / weight - mean * mean).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_rectified_numbers_are_those_of_the_closed_form() {
        // Standard normal: mean 1 / sqrt(2 pi), second moment 1 / 2.
        let (mean, variance) = rectified_moments(0.0, 1.0);
        let exact = 1.0 / (2.0 * std::f32::consts::PI).sqrt();
        assert!((mean - exact).abs() < 1e-3, "{mean}");
        assert!(
            (variance - (0.5 - exact * exact)).abs() < 2e-3,
            "{variance}"
        );
        let (mean, variance) = rectified_moments(20.0, 2.0);
        assert!((mean - 20.0).abs() < 1e-3 && (variance - 4.0).abs() < 0.02);
        assert_eq!(rectified_moments(-20.0, 2.0), (0.0, 0.0));
    }
}
