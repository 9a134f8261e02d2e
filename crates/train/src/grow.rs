//! A large encoder grown from a small trained one, where no weights of its own can be had (Net2Net; Chen, Goodfellow and Shlens
//! 2016): the first channels compute what the small one does, the others start from random numbers and are not listened to yet.

use crate::TrainError;
use crate::parameters::{Parameters, host};
use grimnet_net::{BATCH_NORM_EPSILON, Domain, Downsample, NetSpec};

/// Values of a 3 x 3 kernel.
const TAPS: usize = 9;
/// The middle one.
const CENTRE: usize = 4;

/// What a convolution of the grown encoder starts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    /// That convolution of the small encoder, (stage, layer).
    Copied(usize, usize),
    /// The identity on what the layer before gives.
    PassedOn,
}

/// A convolution of the grown encoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layer {
    start: Start,
    /// Channels that it takes and gives as the small encoder does.
    known: [usize; 2],
    /// All channels that it takes.
    inputs: usize,
}

/// For each stage of `large` its convolutions, or `None` where `small` does not fit into it.
///
/// Layers keep the resolution that they work at. Where the small encoder halves by stride and the large one by a maximum
/// after each stage, a stage takes the small one's layers behind the halving before, then the one that halves, for the
/// maximum halves what it gives. The layers behind the last halving have no place then.
fn plan(small: &NetSpec, large: &NetSpec) -> Option<Vec<Vec<Layer>>> {
    let (mut known, mut inputs) = (3, 3);
    // Layers behind a halving, whose resolution the next stage works at.
    let mut behind = Vec::new();
    let mut out = Vec::new();
    for (s, (from, to)) in small.stages.iter().zip(&large.stages).enumerate() {
        let mut own = (0..from.widths.len()).map(|layer| Start::Copied(s, layer));
        let mut starts = std::mem::take(&mut behind);
        match (from.downsample, to.downsample) {
            (Downsample::StrideFirst, Downsample::MaxPoolLast) => {
                starts.extend(own.next());
                behind = own.collect();
            }
            (from_halves, to_halves) if from_halves == to_halves => starts.extend(own),
            _ => return None,
        }
        if starts.len() > to.widths.len() {
            return None;
        }
        starts.resize(to.widths.len(), Start::PassedOn);
        let mut layers = Vec::new();
        for (start, &width) in starts.into_iter().zip(&to.widths) {
            let outputs = match start {
                Start::Copied(stage, layer) => small.stages[stage].widths[layer],
                Start::PassedOn => known,
            };
            if outputs > width {
                return None;
            }
            layers.push(Layer {
                start,
                known: [known, outputs],
                inputs,
            });
            (known, inputs) = (outputs, width);
        }
        out.push(layers);
    }
    Some(out)
}

/// `large` with an encoder that starts from `small`'s, or `None` where that does not fit into it. Decoder and heads stay as
/// they are.
///
/// # Errors
/// Where the device does not give the numbers back.
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
    // What the last copied layer gives, and every identity behind it, by domain.
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

/// The normalisation of a layer's first channels for one domain.
struct Norm {
    gamma: Vec<f32>,
    beta: Vec<f32>,
    mean: Vec<f32>,
    variance: Vec<f32>,
}

impl Norm {
    /// That of a layer whose convolution gives `shift` less than it did.
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

    /// The one that changes nothing in channels of these means and variances.
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

    /// Makes it that of a layer's first channels.
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

/// The 3 x 3 kernels, `[n, n, 3, 3]`, that give what they take.
fn identity(n: usize) -> Vec<f32> {
    let mut kernel = vec![0.0; n * n * TAPS];
    for i in 0..n {
        kernel[(i * n + i) * TAPS + CENTRE] = 1.0;
    }
    kernel
}

/// Puts `kernel` `[n, taken, 3, 3]` into the first rows and columns of `weight` `[_, inputs, 3, 3]`; the rows' other columns
/// become 0.
fn embed(kernel: &[f32], taken: usize, weight: &mut [f32], inputs: usize) {
    let rows = kernel.chunks_exact(taken * TAPS);
    for (row, wide) in rows.zip(weight.chunks_exact_mut(inputs * TAPS)) {
        let (known, rest) = wide.split_at_mut(taken * TAPS);
        known.copy_from_slice(row);
        rest.fill(0.0);
    }
}

/// Makes a first convolution `[n, 3, 3, 3]` for pictures as `from` normalises them one for pictures as `to` does; what it
/// gives is smaller by the returned `n` values then.
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

/// Mean and variance of `max(x, 0)` where x is normal with that mean and deviation: what DA-BN and ReLU give.
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
    use crate::network::{Input, Network, Part, Statistics};
    use crate::test_numbers::uniform;
    use burn::tensor::{Device, Tensor, TensorData};
    use grimnet_net::{Model, Stage};

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
    fn vgg16_has_room_for_compact_and_compact_none_for_vgg16() {
        let plan_of = plan(&NetSpec::compact(), &NetSpec::vgg16()).unwrap();
        let starts = |stage: usize| plan_of[stage].iter().map(|layer| layer.start);
        use Start::{Copied, PassedOn};
        assert!(starts(0).eq([Copied(0, 0), PassedOn]));
        assert!(starts(1).eq([Copied(0, 1), Copied(1, 0)]));
        assert!(starts(2).eq([Copied(1, 1), Copied(2, 0), PassedOn]));
        assert!(starts(4).eq([Copied(3, 1), Copied(4, 0), PassedOn]));
        assert_eq!(plan_of[2][0].known, [48, 48]);
        assert_eq!(plan_of[2][0].inputs, 128);
        assert_eq!(plan(&NetSpec::vgg16(), &NetSpec::compact()), None);
        assert!(plan(&NetSpec::vgg16_lateral(), &NetSpec::vgg16()).is_some());
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
