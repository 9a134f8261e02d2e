//! torchvision's `vgg16` and `vgg16_bn` as this network's encoder.

use super::torch_file::NamedTensor;
use grimnet_net::{BATCH_NORM_EPSILON, Domain, NetSpec};
use std::collections::BTreeMap;

/// The encoder's tensors, by this network's names, of a torchvision state dictionary.
///
/// The 13 convolutions are the four-dimensional `features.N.weight` in the order of N. `vgg16_bn` has its normalisation at
/// `features.N+1`; both domains start with it. Plain `vgg16` has none: it becomes the identity, with the convolution's bias
/// as its shift. A normalised convolution's own bias goes into the normalisation's mean.
///
/// # Errors
/// What does not fit, in words.
pub fn encoder_from_torchvision(
    tensors: &BTreeMap<String, NamedTensor>,
) -> Result<Vec<(String, Vec<f32>)>, String> {
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
            "it has {} convolutions named features.N.weight; torchvision's vgg16 and vgg16_bn have {}",
            layers.len(),
            wanted.len()
        ));
    }
    let mut out = Vec::new();
    let mut channels = 3;
    for ((index, weight), (name, width)) in layers.into_iter().zip(wanted) {
        if weight.shape != [width, channels, 3, 3] {
            return Err(format!(
                "features.{index}.weight is {:?}, not [{width}, {channels}, 3, 3]",
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
    Ok(out)
}

/// Weight, bias, mean and variance after the convolution `features.index`.
fn normalisation(
    tensors: &BTreeMap<String, NamedTensor>,
    index: usize,
    width: usize,
) -> Result<[(&'static str, Vec<f32>); 4], String> {
    let of = |name: String| -> Result<Option<Vec<f32>>, String> {
        match tensors.get(&name) {
            Some(tensor) if tensor.values.len() == width => Ok(Some(tensor.values.clone())),
            Some(tensor) => Err(format!(
                "{name} has {} values, not {width}",
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
