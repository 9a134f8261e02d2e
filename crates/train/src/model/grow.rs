//! Initialising a large encoder from a smaller trained one (Net2Net; Chen, Goodfellow and Shlens 2016): the first channels of
//! each layer compute the same as the small encoder; the others have random weights, and the first channels ignore them.

use crate::error::TrainError;
use crate::model::grow_plan::{Layer, Start, plan};
use crate::model::parameters::{Parameters, host};
use grimnet_net::{BATCH_NORM_EPSILON, Domain, NetSpec};

/// Values of a 3 x 3 kernel.
const TAPS: usize = 9;
/// The middle one.
const CENTRE: usize = 4;

/// `large` with an encoder initialised from that of `small`; `None` if it does not fit. Decoder and heads do not change.
///
/// # Errors
/// Returns an error if values cannot be read from the device.
pub(crate) fn grow_encoder(
    small: &Parameters,
    mut large: Parameters,
) -> Result<Option<Parameters>, TrainError> {
    let Some(plan) = plan(small.spec(), large.spec()) else {
        return Ok(None);
    };
    let layers = plan.iter().enumerate().flat_map(|(s, layers)| {
        let named = move |(c, layer): (usize, &Layer)| (format!("encoder.{s}.{c}"), *layer);
        layers.iter().enumerate().map(named)
    });
    // Moments of the channels after the last copied layer, by domain; identities after it keep them.
    let mut given = Domain::ALL.map(|_| Vec::new());
    for (index, (name, layer)) in layers.enumerate() {
        let [taken, outputs] = layer.known;
        let source = match layer.start {
            Start::Copied(stage, layer) => Some(format!("encoder.{stage}.{layer}")),
            Start::PassedOn => None,
        };
        let mut kernel = match &source {
            Some(source) => host(small.flat(&format!("{source}.weight"))?)?,
            None => identity(taken),
        };
        let shift = if index == 0 {
            fold_picture(&mut kernel, small.spec(), large.spec())
        } else {
            vec![0.0; outputs]
        };
        let wide = format!("{name}.weight");
        let mut weight = host(large.flat(&wide)?)?;
        embed(&kernel, taken, &mut weight, layer.inputs);
        large.set_from_host(&wide, weight)?;
        for (domain, given) in Domain::ALL.into_iter().zip(&mut given) {
            let norm = match &source {
                Some(source) => {
                    let norm = Norm::of(small, source, domain, &shift)?;
                    *given = norm.moments_after();
                    norm
                }
                None => Norm::identity(given),
            };
            norm.put(&mut large, &name, domain)?;
        }
    }
    Ok(Some(large))
}

/// The normalisation of a layer's first channels in one domain.
struct Norm {
    gamma: Vec<f32>,
    beta: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Norm {
    /// That of a layer whose convolution now gives values smaller by `shift`.
    fn of(
        parameters: &Parameters,
        layer: &str,
        domain: Domain,
        shift: &[f32],
    ) -> Result<Self, TrainError> {
        let part = |part: &str| host(parameters.flat(&domain.norm_name(layer, part))?);
        let mean = part("mean")?;
        Ok(Self {
            gamma: part("weight")?,
            beta: part("bias")?,
            mean: mean.iter().zip(shift).map(|(m, s)| m - s).collect(),
            variance: part("var")?,
        })
    }

    /// The identity for channels with these means and variances.
    fn identity(moments: &[(f32, f32)]) -> Self {
        let (mean, variance): (Vec<f32>, Vec<f32>) = moments.iter().copied().unzip();
        let deviation = |v: &f32| (v + BATCH_NORM_EPSILON).sqrt();
        Self {
            gamma: variance.iter().map(deviation).collect(),
            beta: mean.clone(),
            mean,
            variance,
        }
    }

    /// Mean and variance of each channel after it and ReLU.
    fn moments_after(&self) -> Vec<(f32, f32)> {
        let channels = self.beta.iter().zip(&self.gamma);
        channels.map(|(b, g)| rectified(*b, *g)).collect()
    }

    /// Writes it to a layer's first channels.
    fn put(
        &self,
        parameters: &mut Parameters,
        layer: &str,
        domain: Domain,
    ) -> Result<(), TrainError> {
        for (part, known) in [
            ("weight", &self.gamma),
            ("bias", &self.beta),
            ("mean", &self.mean),
            ("var", &self.variance),
        ] {
            let name = domain.norm_name(layer, part);
            let mut values = host(parameters.flat(&name)?)?;
            values[..known.len()].copy_from_slice(known);
            parameters.set_from_host(&name, values)?;
        }
        Ok(())
    }
}

/// The identity as 3 x 3 kernels, `[n, n, 3, 3]`.
fn identity(n: usize) -> Vec<f32> {
    let mut kernel = vec![0.0; n * n * TAPS];
    for i in 0..n {
        kernel[(i * n + i) * TAPS + CENTRE] = 1.0;
    }
    kernel
}

/// Copies `kernel` `[n, taken, 3, 3]` to the first rows and columns of `weight` `[_, inputs, 3, 3]`; the other columns of
/// these rows become 0.
fn embed(kernel: &[f32], taken: usize, weight: &mut [f32], inputs: usize) {
    let rows = kernel.chunks_exact(taken * TAPS);
    for (row, wide) in rows.zip(weight.chunks_exact_mut(inputs * TAPS)) {
        let (known, rest) = wide.split_at_mut(taken * TAPS);
        known.copy_from_slice(row);
        rest.fill(0.0);
    }
}

/// Adapts a first convolution `[n, 3, 3, 3]` from the picture normalisation of `from` to that of `to`. Its outputs are
/// smaller by the returned `n` values afterwards.
fn fold_picture(kernel: &mut [f32], from: &NetSpec, to: &NetSpec) -> Vec<f32> {
    let fold = |filter: &mut [f32]| {
        let mut lost = 0.0;
        for (channel, taps) in filter.chunks_exact_mut(TAPS).enumerate() {
            let offset =
                (to.input_mean[channel] - from.input_mean[channel]) / from.input_std[channel];
            let scale = to.input_std[channel] / from.input_std[channel];
            for tap in taps {
                lost += *tap * offset;
                *tap *= scale;
            }
        }
        lost
    };
    kernel.chunks_exact_mut(3 * TAPS).map(fold).collect()
}

/// Mean and variance of `max(x, 0)` for a normally distributed `x`, as after batch normalisation and ReLU.
fn rectified(mean: f32, deviation: f32) -> (f32, f32) {
    const STEPS: i32 = 400;
    let [mut total, mut first, mut second] = [0.0f64; 3];
    for i in -STEPS..=STEPS {
        let z = 6.0 * f64::from(i) / f64::from(STEPS);
        let density = (-z * z / 2.0).exp();
        let x = (f64::from(mean) + f64::from(deviation) * z).max(0.0);
        total += density;
        first += density * x;
        second += density * x * x;
    }
    let mean = first / total;
    (mean as f32, (second / total - mean * mean).max(0.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::input::{Input, Part};
    use crate::model::network::Network;
    use crate::model::normalisation::Statistics;
    use crate::test_numbers::uniform;
    use burn::tensor::{Device, Tensor, TensorData};
    use grimnet_net::{Downsample, Model, Stage};

    const SIDE: usize = 64;

    fn spec(widths: [&[usize]; 5], downsample: Downsample) -> NetSpec {
        let stage = |widths: &[usize]| Stage {
            widths: widths.to_vec(),
            downsample,
        };
        NetSpec {
            stages: widths.map(stage).into(),
            global_dim: 0,
            ..NetSpec::vgg16()
        }
    }

    /// A network whose normalisations are none of the identity.
    fn some_network(spec: &NetSpec, seed: u64) -> Parameters {
        let model = Model::random(spec, seed).unwrap();
        let mut parameters = Parameters::of_model(&model, &Device::flex());
        for (i, name) in parameters.names().into_iter().enumerate() {
            if name.contains(".norm.") {
                let range = if name.ends_with(".bias") || name.ends_with(".mean") {
                    -0.5..0.5
                } else {
                    0.5..1.5
                };
                let length = parameters.flat(&name).unwrap().dims()[0];
                parameters
                    .set_from_host(&name, uniform(length, range, i as u64))
                    .unwrap();
            }
        }
        parameters
    }

    /// The stages' features, `[picture, y, x, channel]`, of a map's and a photo's picture (0 to 1).
    fn stages(parameters: &Parameters, picture: &[f32]) -> Vec<Tensor<4>> {
        let device = Device::flex();
        let spec = parameters.spec();
        let normalised = picture
            .iter()
            .enumerate()
            .map(|(i, v)| (v - spec.input_mean[i % 3]) / spec.input_std[i % 3])
            .collect::<Vec<f32>>();
        let parts = Domain::ALL.map(|domain| Part {
            pictures: 1,
            domain,
        });
        let cells = SIDE / 8;
        let input = Input {
            pictures: Tensor::from_data(TensorData::new(normalised, [2, SIDE, SIDE, 3]), &device),
            grey_cells: Tensor::zeros([2, cells, cells, 64], &device),
            seen: Tensor::ones([2, cells * cells, 1], &device),
            parts: parts.to_vec(),
        };
        Network::new(parameters, Statistics::Running)
            .encode(&input)
            .unwrap()
    }

    fn picture() -> Vec<f32> {
        uniform(2 * SIDE * SIDE * 3, 0.0..1.0, 77)
    }

    /// The largest difference between a small network's features and the first channels of a grown one's, at least `margin`
    /// away from the picture's edge.
    fn largest_difference(small: &Tensor<4>, grown: &Tensor<4>, margin: usize) -> f32 {
        let [n, h, w, c] = small.dims();
        let inner = |x: &Tensor<4>| {
            x.clone()
                .slice([0..n, margin..h - margin, margin..w - margin, 0..c])
        };
        let difference = (inner(small) - inner(grown)).abs().max();
        host(difference).unwrap()[0]
    }

    #[test]
    fn a_wider_and_deeper_encoder_computes_what_the_small_one_does() {
        let small = spec(
            [&[4], &[5, 6], &[8], &[8, 8], &[7]],
            Downsample::StrideFirst,
        );
        let large = spec(
            [&[6, 9], &[9, 9, 9], &[12, 8], &[9, 10], &[8]],
            Downsample::StrideFirst,
        );
        let (small, large) = (some_network(&small, 1), some_network(&large, 2));
        let grown = grow_encoder(&small, large.clone()).unwrap().unwrap();
        let picture = picture();
        for (a, b) in stages(&small, &picture)
            .iter()
            .zip(stages(&grown, &picture))
        {
            let scale = host(a.clone().abs().max()).unwrap()[0];
            assert!(largest_difference(a, &b, 0) < 1e-4 * scale.max(1.0));
        }
        let decoder = |parameters: &Parameters| host(parameters.flat("descriptor.weight").unwrap());
        assert_eq!(decoder(&grown).unwrap(), decoder(&large).unwrap());
    }

    #[test]
    fn pictures_may_be_normalised_otherwise() {
        let small = NetSpec {
            input_mean: [0.45; 3],
            input_std: [0.25; 3],
            ..spec([&[4], &[4], &[4], &[4], &[4]], Downsample::StrideFirst)
        };
        let large = spec([&[6], &[6], &[6], &[6], &[6]], Downsample::StrideFirst);
        let (small, large) = (some_network(&small, 3), some_network(&large, 4));
        let grown = grow_encoder(&small, large).unwrap().unwrap();
        let picture = picture();
        // What lies outside the picture is 0 after either normalisation, so that the first row and column differ.
        let (a, b) = (&stages(&small, &picture)[0], &stages(&grown, &picture)[0]);
        assert!(largest_difference(a, b, 1) < 1e-4);
        assert!(largest_difference(a, b, 0) > 1e-3);
    }

    #[test]
    fn a_maximum_takes_over_the_halving() {
        let small = spec([&[4], &[4], &[4], &[4], &[4]], Downsample::StrideFirst);
        let large = spec([&[6], &[6], &[6], &[6], &[6]], Downsample::MaxPoolLast);
        let (small, large) = (some_network(&small, 5), some_network(&large, 6));
        let grown = grow_encoder(&small, large).unwrap().unwrap();
        let picture = picture();
        let (a, b) = (&stages(&small, &picture)[0], &stages(&grown, &picture)[0]);
        // Of the four places under the maximum, the stride takes the first.
        let excess = b.clone().narrow(3, 0, 4) - a.clone();
        assert!(host(excess.clone().min()).unwrap()[0] > -1e-5);
        let equal = host(excess.lower_elem(1e-5).float().mean()).unwrap()[0];
        assert!((0.1..0.9).contains(&equal), "{equal}");
    }

    #[test]
    fn what_a_normalisation_gives_has_known_moments() {
        // Of the half-normal distribution, one half of it at 0.
        let (mean, variance) = rectified(0.0, 1.0);
        assert!((mean - 0.398_942).abs() < 1e-3 && (variance - 0.340_845).abs() < 1e-3);
        let (mean, variance) = rectified(9.0, -1.5);
        assert!((mean - 9.0).abs() < 1e-3 && (variance - 2.25).abs() < 1e-3);
    }
}
