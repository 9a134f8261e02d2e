//! Normalisations that change nothing, for an encoder whose weights were trained without normalisation.

use crate::error::TrainError;
use crate::model::input::{Input, Part};
use crate::model::parameters::{Parameters, host};
use crate::ops::conv3x3;
use burn::tensor::Tensor;
use burn::tensor::module::max_pool2d;
use burn::tensor::ops::MaxPoolOptions;
use grimnet_net::{BATCH_NORM_EPSILON, Domain, Downsample};

/// Makes every normalisation of the encoder the identity plus the layer's bias, under running statistics and, for batches like
/// `input`, under batch statistics: with mean `mu` and variance `var` of the convolution's output in a domain, gamma becomes
/// `sqrt(var + eps)` and beta `mu + bias`. The biases are the present betas, as the import of weights without normalisation
/// sets them. A domain without pictures in `input` keeps its normalisation.
///
/// # Errors
/// Returns an error if values cannot be read from the device.
pub(crate) fn set_identity_norms(
    parameters: &mut Parameters,
    input: &Input,
) -> Result<(), TrainError> {
    let mut x = input.pictures.clone();
    let stages = parameters.spec().stages.clone();
    for (s, stage) in stages.iter().enumerate() {
        for c in 0..stage.widths.len() {
            let layer = format!("encoder.{s}.{c}");
            let weight = parameters.shaped::<4>(&format!("{layer}.weight"))?;
            let strided = c == 0 && stage.downsample == Downsample::StrideFirst;
            let z = conv3x3(x, weight, if strided { 2 } else { 1 });
            let bias = parameters.flat(&Domain::Sat.norm_name(&layer, "bias"))?;
            for domain in Domain::ALL {
                set_identity(parameters, &layer, domain, &z, &input.parts)?;
            }
            x = (z + bias.unsqueeze::<4>()).clamp_min(0.0);
        }
        if stage.downsample == Downsample::MaxPoolLast {
            let pooled = max_pool2d(x.permute([0, 3, 1, 2]), MaxPoolOptions::new([2, 2]));
            x = pooled.permute([0, 2, 3, 1]);
        }
    }
    Ok(())
}

/// Sets one normalisation from the outputs `z` `[n, h, w, c]` of its convolution.
fn set_identity(
    parameters: &mut Parameters,
    layer: &str,
    domain: Domain,
    z: &Tensor<4>,
    parts: &[Part],
) -> Result<(), TrainError> {
    let [_, h, w, c] = z.dims();
    let (mut rows, mut first) = (Vec::new(), 0);
    for part in parts {
        if part.domain == domain {
            let pictures = z.clone().narrow(0, first, part.pictures);
            rows.push(pictures.reshape([part.pictures * h * w, c]));
        }
        first += part.pictures;
    }
    if rows.is_empty() {
        return Ok(());
    }
    let rows = Tensor::cat(rows, 0);
    let mean = rows.clone().mean_dim(0);
    let variance = host((rows - mean.clone()).square().mean_dim(0))?;
    let mean = host(mean)?;
    let bias = host(parameters.flat(&domain.norm_name(layer, "bias"))?)?;
    let gamma = variance.iter().map(|v| (v + BATCH_NORM_EPSILON).sqrt());
    let beta = mean.iter().zip(&bias).map(|(m, b)| m + b);
    for (part, values) in [
        ("weight", gamma.collect::<Vec<f32>>()),
        ("bias", beta.collect()),
        ("mean", mean.clone()),
        ("var", variance.clone()),
    ] {
        parameters.set_from_host(&domain.norm_name(layer, part), values)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::network::Network;
    use crate::model::normalisation::Statistics;
    use crate::test_numbers::uniform;
    use burn::tensor::{Device, TensorData};
    use grimnet_net::{Model, NetSpec, Stage};

    const SIDE: usize = 64;
    const PICTURES: usize = 4;

    /// Under either kind of statistics the network computes what it did with its biases and without normalisation.
    #[test]
    fn activations_stay_as_they_were_under_batch_and_running_statistics() {
        let spec = NetSpec {
            stages: [&[6, 6][..], &[8], &[8, 10], &[12], &[12]]
                .map(|widths| Stage {
                    widths: widths.to_vec(),
                    downsample: Downsample::MaxPoolLast,
                })
                .into(),
            global_dim: 0,
            ..NetSpec::vgg16()
        };
        let device = Device::flex();
        let model = Model::random(&spec, 5).unwrap();
        let mut parameters = Parameters::of_model(&model, &device);
        for (i, name) in parameters.names().into_iter().enumerate() {
            // Random networks have mean 0 and variance 1; the weights of the other parts are 1.
            if name.starts_with("encoder.") && name.ends_with(".norm.sat.bias") {
                let length = parameters.flat(&name).unwrap().dims()[0];
                let bias = uniform(length, -0.5..0.5, i as u64);
                let photo = name.replace(".sat.", ".uav.");
                parameters.set_from_host(&name, bias.clone()).unwrap();
                parameters.set_from_host(&photo, bias).unwrap();
            }
            if name.starts_with("encoder.") && name.ends_with(".var") {
                let length = parameters.flat(&name).unwrap().dims()[0];
                let one = vec![1.0 - BATCH_NORM_EPSILON; length];
                parameters.set_from_host(&name, one).unwrap();
            }
        }
        let values = uniform(PICTURES * SIDE * SIDE * 3, -2.0..2.0, 9);
        let cells = SIDE / 8;
        let input = Input {
            pictures: Tensor::from_data(
                TensorData::new(values, [PICTURES, SIDE, SIDE, 3]),
                &device,
            ),
            grey_cells: Tensor::zeros([PICTURES, cells, cells, 64], &device),
            seen: Tensor::ones([PICTURES, cells * cells, 1], &device),
            parts: Domain::ALL
                .map(|domain| Part {
                    pictures: PICTURES / 2,
                    domain,
                })
                .to_vec(),
        };
        let stages = |parameters: &Parameters, statistics| {
            let mut network = Network::new(parameters, statistics);
            network.encode(&input).unwrap()
        };
        let before = stages(&parameters, Statistics::Running);
        let differs = |after: &[Tensor<4>]| {
            let pairs = before.iter().zip(after);
            let largest = |(a, b): (&Tensor<4>, &Tensor<4>)| {
                let scale = host(a.clone().abs().max()).unwrap()[0];
                host((a.clone() - b.clone()).abs().max()).unwrap()[0] / scale
            };
            pairs.map(largest).fold(0.0f32, f32::max)
        };
        assert!(differs(&stages(&parameters, Statistics::Batch)) > 0.1);
        set_identity_norms(&mut parameters, &input).unwrap();
        for statistics in [Statistics::Running, Statistics::Batch] {
            let found = differs(&stages(&parameters, statistics));
            assert!(found < 1e-3, "{statistics:?}: {found}");
        }
    }
}
