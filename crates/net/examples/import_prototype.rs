//! Converts weights with PyTorch's names, as the prototype of the compact network wrote them, to a grimnet model file.
//!
//! ```text
//! cargo run --release -p grimnet-net --example import_prototype -- WEIGHTS.safetensors MODEL.safetensors [TRAINING-DATA] [LICENCE]
//! ```
//!
//! Widths, layers and clusters are read from the tensors' shapes. Convolution weights are rounded to half precision.

use std::collections::BTreeMap;
use std::error::Error;

use grimnet_net::{
    Card, Decoder, Downsample, KeypointHead, Model, NetSpec, Stage, Vlad, VladInput,
};
use safetensors::{Dtype, SafeTensors};

type Tensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, about @ ..] = &arguments[..] else {
        return Err("usage: import_prototype WEIGHTS.safetensors MODEL.safetensors [TRAINING-DATA] [LICENCE]".into());
    };
    let about = |i: usize| about.get(i).cloned().unwrap_or_else(|| "not stated".into());
    let tensors = read(input)?;
    let spec = spec_of(&tensors)?;
    let card = Card {
        name: format!("{}, imported", spec.preset),
        training_data: about(0),
        licence: about(1),
        notes: "Imported from a PyTorch prototype.".into(),
        ..Card::default()
    };
    let values = tensors
        .into_iter()
        .map(|(name, (_, values))| (grimnet_name(&name), values));
    let model = Model::from_values(spec, card, values)?;
    model.save(output)?;
    Ok(())
}

fn read(path: &str) -> Result<Tensors, Box<dyn Error>> {
    let bytes = fs_err::read(path)?;
    let file = SafeTensors::deserialize(&bytes)?;
    let mut tensors = Tensors::new();
    for (name, tensor) in file.iter() {
        if tensor.dtype() != Dtype::F32 {
            return Err(format!(
                "{path}: `{name}` is {:?}, and F32 is needed",
                tensor.dtype()
            )
            .into());
        }
        let (numbers, _) = tensor.data().as_chunks::<4>();
        let values = numbers.iter().map(|b| f32::from_le_bytes(*b)).collect();
        tensors.insert(name.to_owned(), (tensor.shape().to_vec(), values));
    }
    Ok(tensors)
}

/// The compact network with the widths that the tensors have.
fn spec_of(tensors: &Tensors) -> Result<NetSpec, Box<dyn Error>> {
    let outputs = |name: &str| tensors.get(name).map(|(shape, _)| shape[0]);
    let needed = |name: &str| outputs(name).ok_or(format!("`{name}` is missing"));
    let stage = |s: usize| {
        let widths = (0..)
            .map_while(|c| outputs(&format!("stages.{s}.{c}.conv.weight")))
            .collect();
        Stage {
            widths,
            downsample: Downsample::StrideFirst,
        }
    };
    let layers = (0..)
        .take_while(|i| tensors.contains_key(&format!("kp.{i}.conv.weight")))
        .count();
    Ok(NetSpec {
        stages: (0..5).map(stage).collect(),
        decoder: Decoder::Lateral {
            width: needed("fuse.conv.weight")?,
        },
        descriptor_dim: needed("desc.weight")?,
        keypoints: KeypointHead::FromGrey {
            width: needed("kp.0.conv.weight")?,
            layers,
        },
        vlad: Vlad {
            input: VladInput::Descriptors,
            clusters: needed("centres")?,
        },
        global_dim: 0,
        ..NetSpec::compact()
    })
}

/// `stages.2.0.norm.bn.1.running_var` is `encoder.2.0.norm.uav.var`, and so on.
fn grimnet_name(pytorch: &str) -> String {
    let parts = [
        ("stages.", "encoder."),
        (".conv.", "."),
        (".bn.0.", ".sat."),
        (".bn.1.", ".uav."),
        (".running_", "."),
        ("kp_out.", "keypoint.out."),
        ("kp.", "keypoint."),
        ("desc.", "descriptor."),
        ("l4.", "lateral.h16."),
        ("l5.", "lateral.h32."),
        ("assign.", "netvlad.assign."),
        ("centres", "netvlad.centres"),
    ];
    parts.iter().fold(pytorch.to_owned(), |name, (from, to)| {
        name.replace(from, to)
    })
}
