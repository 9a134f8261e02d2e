//! The encoder of torchvision's `vgg16` and `vgg16_bn`.

use super::torch_file::NamedTensor;
use grimnet_net::{BATCH_NORM_EPSILON, Domain, NetSpec};
use std::collections::BTreeMap;

/// The encoder of torchvision's VGG-16.
#[derive(Clone, Debug)]
pub struct TorchvisionEncoder {
    /// Values by tensor name, with the names and shapes of [`NetSpec::vgg16`].
    pub tensors: Vec<(String, Vec<f32>)>,
    /// Whether the weights come with batch normalisation (`vgg16_bn`). Without it the normalisations are the identity under
    /// running statistics, with the convolutions' biases as their shifts.
    pub has_norms: bool,
}

/// The encoder of a torchvision state dictionary.
///
/// The 13 convolutions are the four-dimensional `features.N.weight` in the order of N. `vgg16_bn` has its normalisations at
/// `features.N+1`, which both domains get; the bias of such a convolution is subtracted from the mean.
///
/// # Errors
/// Returns what is missing or has a wrong shape.
pub fn encoder_from_torchvision(
    tensors: &BTreeMap<String, NamedTensor>,
) -> Result<TorchvisionEncoder, String> {
    let mut layers: Vec<(usize, &NamedTensor)> = tensors
        .iter()
        .filter(|(_, tensor)| tensor.shape.len() == 4)
        .filter_map(|(name, tensor)| {
            let index = name.strip_prefix("features.")?.strip_suffix(".weight")?;
            Some((index.parse().ok()?, tensor))
        })
        .collect();
    layers.sort_by_key(|(index, _)| *index);
    let spec = NetSpec::vgg16();
    let wanted: Vec<(String, usize)> = spec
        .stages
        .iter()
        .enumerate()
        .flat_map(|(s, stage)| {
            let layer = move |(c, width): (usize, &usize)| (format!("encoder.{s}.{c}"), *width);
            stage.widths.iter().enumerate().map(layer)
        })
        .collect();
    if layers.len() != wanted.len() {
        return Err(format!(
            "found {} convolutions named features.N.weight; expected the {} of torchvision's vgg16 or vgg16_bn",
            layers.len(),
            wanted.len()
        ));
    }
    let mut out = Vec::new();
    let mut channels = 3;
    for ((index, weight), (name, width)) in layers.into_iter().zip(wanted) {
        if weight.shape != [width, channels, 3, 3] {
            return Err(format!(
                "features.{index}.weight has shape {:?}; expected [{width}, {channels}, 3, 3]",
                weight.shape
            ));
        }
        channels = width;
        out.push((format!("{name}.weight"), weight.values.clone()));
        for (part, values) in normalisation(tensors, index, width)? {
            for domain in Domain::ALL {
                out.push((domain.norm_name(&name, part), values.clone()));
            }
        }
    }
    let has_norms = tensors.keys().any(|name| name.ends_with(".running_mean"));
    Ok(TorchvisionEncoder {
        tensors: out,
        has_norms,
    })
}

/// Weight, bias, mean and variance of the normalisation after the convolution `features.index`.
fn normalisation(
    tensors: &BTreeMap<String, NamedTensor>,
    index: usize,
    width: usize,
) -> Result<[(&'static str, Vec<f32>); 4], String> {
    let of = |name: String| -> Result<Option<Vec<f32>>, String> {
        match tensors.get(&name) {
            Some(tensor) if tensor.values.len() == width => Ok(Some(tensor.values.clone())),
            Some(tensor) => Err(format!(
                "{name} has {} values; expected {width}",
                tensor.values.len()
            )),
            None => Ok(None),
        }
    };
    let shift = of(format!("features.{index}.bias"))?.unwrap_or_else(|| vec![0.0; width]);
    let part = |part: &str| of(format!("features.{}.{part}", index + 1));
    Ok(
        match (
            part("weight")?,
            part("bias")?,
            part("running_mean")?,
            part("running_var")?,
        ) {
            (Some(weight), Some(bias), Some(mean), Some(var)) => {
                let mean = mean.iter().zip(&shift).map(|(m, s)| m - s).collect();
                [
                    ("weight", weight),
                    ("bias", bias),
                    ("mean", mean),
                    ("var", var),
                ]
            }
            _ => [
                ("weight", vec![1.0; width]),
                ("bias", shift),
                ("mean", vec![0.0; width]),
                ("var", vec![1.0 - BATCH_NORM_EPSILON; width]),
            ],
        },
    )
}
