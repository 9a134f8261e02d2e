//! What a new run starts with: random numbers, those of a model or of another run, or another program's encoder.

use crate::TrainError;
use crate::checkpoint::{Checkpoint, Position};
use crate::config::TrainConfig;
use crate::grow::grow_encoder;
use crate::import::{encoder_from_torchvision, read_tensors};
use crate::optimiser::Adam;
use crate::parameters::Parameters;
use burn::tensor::Device;
use grimnet_net::{Model, NetSpec};
use std::path::Path;

/// The first state of a run, with a classifier of that many scenes.
///
/// # Errors
/// `start_from` that cannot be read, or holds another network.
pub(crate) fn first_state(
    config: &TrainConfig,
    scenes: usize,
    device: &Device,
) -> Result<Checkpoint, TrainError> {
    let random = Parameters::of_model(&Model::random(&config.spec()?, config.seed)?, device);
    let (parameters, centres_started) = match &config.start_from {
        None => (random, false),
        Some(path) => started_from(path, random, config, device)?,
    };
    let parameters = parameters.with_classifier(scenes, device);
    Ok(Checkpoint {
        average: parameters.clone(),
        parameters,
        adam: Adam::default(),
        position: Position {
            centres_started,
            stage: config.stage,
            ..Position::default()
        },
    })
}

/// The averaged numbers of a checkpoint or those of a model file, whole or all but another kind of NetVLAD; random ones with an
/// encoder that grows from either, or with another program's encoder. And whether NetVLAD's centres are among them.
fn started_from(
    path: &Path,
    random: Parameters,
    config: &TrainConfig,
    device: &Device,
) -> Result<(Parameters, bool), TrainError> {
    let (found, centres_started) = if Checkpoint::is_one(path)? {
        let checkpoint = Checkpoint::open(path, device)?;
        (
            checkpoint.average.with_classifier(0, device),
            checkpoint.position.centres_started,
        )
    } else if let Ok(model) = Model::open(path) {
        (Parameters::of_model(&model, device), true)
    } else {
        return Ok((with_encoder(path, random)?, false));
    };
    if found.spec() != random.spec() {
        if differs_in_netvlad_alone(found.spec(), random.spec()) {
            tracing::info!(
                "{}: all but NetVLAD is taken from it; NetVLAD of `{}` gathers other vectors",
                path.display(),
                config.network
            );
            return Ok((with_all_but_netvlad(&found, random)?, false));
        }
        if let Some(grown) = grow_encoder(&found, random)? {
            tracing::info!(
                "{}: the encoder of `{}` grows from it; the rest starts from random numbers",
                path.display(),
                config.network
            );
            return Ok((grown, false));
        }
        return Err(TrainError::Checkpoint {
            path: path.to_owned(),
            reason: format!(
                "it holds another network than `{}`, and not a smaller one that this could grow from; leave `start_from` out, or name a file of this network",
                config.network
            ),
        });
    }
    Ok((found, centres_started))
}

/// Whether two networks see and describe points alike, and only gather the descriptors of a place differently.
fn differs_in_netvlad_alone(one: &NetSpec, other: &NetSpec) -> bool {
    let gathering_as_other = NetSpec {
        vlad: other.vlad,
        ..one.clone()
    };
    gathering_as_other == *other
}

/// The parameters with all numbers of a network but NetVLAD's.
fn with_all_but_netvlad(
    found: &Parameters,
    mut parameters: Parameters,
) -> Result<Parameters, TrainError> {
    for name in found.names() {
        if !name.starts_with("netvlad.") {
            parameters.set(&name, found.flat(&name)?)?;
        }
    }
    Ok(parameters)
}

/// The parameters with torchvision's encoder.
fn with_encoder(path: &Path, mut parameters: Parameters) -> Result<Parameters, TrainError> {
    let wrong = |reason: String| TrainError::Weights {
        path: path.to_owned(),
        reason,
    };
    let encoder = encoder_from_torchvision(&read_tensors(path)?).map_err(wrong)?;
    if parameters.spec().stages != NetSpec::vgg16().stages {
        return Err(wrong(
            "it fits `network = \"vgg16\"` and `\"vgg16-lateral\"` only, as it comes from torchvision".into(),
        ));
    }
    for (name, values) in encoder {
        parameters.set_from_host(&name, values)?;
    }
    Ok(parameters)
}
