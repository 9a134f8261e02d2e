//! Weights as signed bytes.

use crate::{ConvSpec, KernelError};

/// Weights are `-LARGEST..=LARGEST`.
const LARGEST: f32 = 127.0;
/// Largest start of a sum that the bias may cause: sums stay within 32 bits.
const LARGEST_BIAS: f32 = (1 << 29) as f32;
/// Most products in a sum, so that it stays within 32 bits.
const MOST_PRODUCTS: usize = 40_000;

/// What the bytes of each channel of an activation stand for: `value = scale * (byte - zero)`.
#[derive(Debug, Clone, PartialEq)]
pub struct ByteScale {
    /// Steps between bytes, greater than 0, one for each channel.
    pub scale: Vec<f32>,
    /// The byte, not necessarily a whole one, that stands for 0, one for each channel.
    pub zero: Vec<f32>,
}

impl ByteScale {
    /// For values from 0 on: byte 0 is 0, byte 255 is the largest value, one for each channel.
    #[must_use]
    pub fn unsigned(largest: &[f32]) -> Self {
        Self {
            scale: largest.iter().map(|&v| step(v)).collect(),
            zero: vec![0.0; largest.len()],
        }
    }

    /// For values between a smallest, at most 0, and a largest, at least 0, for each channel. The bytes of zero are whole numbers.
    ///
    /// # Panics
    /// If the slices differ in length.
    #[must_use]
    pub fn signed(smallest: &[f32], largest: &[f32]) -> Self {
        assert_eq!(smallest.len(), largest.len(), "channels of the two limits");
        let scale: Vec<f32> = smallest
            .iter()
            .zip(largest)
            .map(|(low, high)| step(high - low))
            .collect();
        let zero = smallest
            .iter()
            .zip(&scale)
            .map(|(low, scale)| (-low / scale).round().clamp(0.0, 255.0))
            .collect();
        Self { scale, zero }
    }

    /// The whole bytes nearest to zero: what a halo is filled with.
    #[must_use]
    pub fn zero_bytes(&self) -> Vec<u8> {
        self.zero.iter().map(|zero| zero.round() as u8).collect()
    }
}

/// The step of 255 steps; a positive number even if nothing but 0 occurs.
fn step(range: f32) -> f32 {
    (range / 255.0).max(f32::MIN_POSITIVE * 1e6)
}

/// A convolution's weights as signed bytes, one scale for each output channel: the real output of channel `o` is
/// `unit[o] * (start[o] + sum of values * bytes)`.
#[derive(Debug, Clone, PartialEq)]
pub struct QuantisedWeights {
    /// `[out, in, kernel, kernel]`, as in PyTorch.
    pub values: Vec<i8>,
    /// Where the sums of an output channel start: the bias, and what the zeros of the input take away.
    pub start: Vec<i32>,
    /// The real number that 1 of a sum stands for, one for each output channel.
    pub unit: Vec<f32>,
}

impl QuantisedWeights {
    /// Rounds `weight_oihw` (`[out, in, kernel, kernel]`) and `bias` (`[out]`) for an input whose bytes stand for `input`.
    ///
    /// # Errors
    /// [`KernelError`] if the specification is not supported, or the slices or `input` do not have its lengths.
    pub fn new(
        spec: ConvSpec,
        weight_oihw: &[f32],
        bias: &[f32],
        input: &ByteScale,
    ) -> Result<Self, KernelError> {
        spec.validate()?;
        check_lengths(spec, weight_oihw.len(), bias.len())?;
        if input.scale.len() != spec.in_channels || input.zero.len() != spec.in_channels {
            return Err(KernelError::ScaleLength {
                expected: spec.in_channels,
                found: input.scale.len().min(input.zero.len()),
            });
        }
        let taps = spec.kernel * spec.kernel;
        let mut quantised = Self {
            values: Vec::with_capacity(weight_oihw.len()),
            start: Vec::with_capacity(bias.len()),
            unit: Vec::with_capacity(bias.len()),
        };
        for (row, &bias) in weight_oihw.chunks_exact(spec.in_channels * taps).zip(bias) {
            let scaled = |i: usize| row[i] * input.scale[i / taps];
            let largest = (0..row.len()).fold(0.0f32, |m, i| m.max(scaled(i).abs()));
            let unit = (largest / LARGEST)
                .max(bias.abs() / LARGEST_BIAS)
                .max(f32::MIN_POSITIVE);
            let mut zeros = 0.0;
            for i in 0..row.len() {
                let value = (scaled(i) / unit).round().clamp(-LARGEST, LARGEST);
                zeros += f64::from(value) * f64::from(input.zero[i / taps]);
                quantised.values.push(value as i8);
            }
            let start = f64::from(bias) / f64::from(unit) - zeros;
            quantised.start.push(start.round() as i32);
            quantised.unit.push(unit);
        }
        Ok(quantised)
    }
}

/// Checks the lengths of weights and of what there is one of for each output channel, and that sums fit into 32 bits.
pub(crate) fn check_lengths(
    spec: ConvSpec,
    weights: usize,
    outputs: usize,
) -> Result<(), KernelError> {
    if weights != spec.weight_len() {
        return Err(KernelError::WeightLength {
            expected: spec.weight_len(),
            found: weights,
        });
    }
    if outputs != spec.out_channels {
        return Err(KernelError::BiasLength {
            expected: spec.out_channels,
            found: outputs,
        });
    }
    let products = spec.weight_len() / spec.out_channels;
    if products > MOST_PRODUCTS {
        return Err(KernelError::LongSum {
            products,
            most: MOST_PRODUCTS,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEC: ConvSpec = ConvSpec {
        in_channels: 2,
        out_channels: 2,
        kernel: 1,
        stride: 1,
    };

    #[test]
    fn units_starts_and_values_are_those_of_the_definition() {
        let input = ByteScale {
            scale: vec![0.5, 0.25],
            zero: vec![0.0, 10.0],
        };
        let weights =
            QuantisedWeights::new(SPEC, &[2.0, -8.0, 0.0, 0.0], &[3.0, -1.0], &input).unwrap();
        // Scaled weights 1 and -2: the unit is 2 / 127.
        assert_eq!(weights.values[..2], [64, -127]);
        assert_eq!(
            weights.start[0],
            (3.0f64 * 127.0 / 2.0 + 1270.0).round() as i32
        );
        // Weights of zero: the bias still comes out.
        let bias = f64::from(weights.start[1]) * f64::from(weights.unit[1]);
        assert!((bias + 1.0).abs() < 1e-6);
    }

    #[test]
    fn scales_cover_their_ranges() {
        let scale = ByteScale::signed(&[-1.0, 0.0], &[3.0, 0.0]);
        assert_eq!(scale.zero_bytes(), [64, 0]);
        assert!((scale.scale[0] * 255.0 - 4.0).abs() < 1e-6 && scale.scale[1] > 0.0);
        assert_eq!(ByteScale::unsigned(&[2.55]).scale, [2.55 / 255.0]);
    }

    #[test]
    fn lengths_that_do_not_fit_are_refused() {
        let input = ByteScale::unsigned(&[1.0]);
        assert!(matches!(
            QuantisedWeights::new(SPEC, &[0.0; 4], &[0.0; 2], &input),
            Err(KernelError::ScaleLength { .. })
        ));
        assert!(QuantisedWeights::new(SPEC, &[0.0; 3], &[0.0; 2], &input).is_err());
        assert!(QuantisedWeights::new(SPEC, &[0.0; 4], &[0.0], &input).is_err());
        let deep = ConvSpec {
            in_channels: MOST_PRODUCTS + 1,
            ..SPEC
        };
        assert!(matches!(
            check_lengths(deep, deep.weight_len(), 2),
            Err(KernelError::LongSum { .. })
        ));
    }
}
