//! The initial state of a run: random weights, those of a model or checkpoint, or an encoder from another program.

use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::import::{encoder_from_torchvision, read_tensors};
use crate::model::grow::grow_encoder;
use crate::model::parameters::Parameters;
use crate::run::checkpoint::{Checkpoint, Position};
use crate::run::optimiser::Adam;
use burn::tensor::Device;
use grimnet_net::{Model, ModelFileError, NetError, NetSpec};
use std::path::Path;

/// The initial state, with a classifier of `scenes` classes.
///
/// # Errors
/// Returns an error if `start_from` cannot be read or does not fit the network.
pub(super) fn initial_state(
    config: &TrainConfig,
    scenes: usize,
    device: &Device,
) -> Result<InitialState, TrainError> {
    let random = Parameters::of_model(&Model::random(&config.spec()?, config.seed)?, device);
    let loaded = match &config.start_from {
        None => Loaded::random(random),
        Some(path) => loaded(path, random, config, device)?,
    };
    let parameters = loaded.parameters.with_classifier(scenes, device);
    Ok(InitialState {
        checkpoint: Checkpoint {
            average: parameters.clone(),
            parameters,
            adam: Adam::default(),
            position: Position {
                centres_started: loaded.netvlad_initialised,
                stage: config.stage,
                ..Position::default()
            },
            config: Some(config.clone()),
        },
        lacks_norms: loaded.lacks_norms,
    })
}

/// The state before the first step.
pub(super) struct InitialState {
    pub(super) checkpoint: Checkpoint,
    /// Whether the encoder's weights come from a network without normalisation.
    pub(super) lacks_norms: bool,
}

/// The parameters of `start_from`.
struct Loaded {
    parameters: Parameters,
    netvlad_initialised: bool,
    lacks_norms: bool,
}

impl Loaded {
    /// Parameters without an initialised NetVLAD.
    fn random(parameters: Parameters) -> Self {
        Self {
            parameters,
            netvlad_initialised: false,
            lacks_norms: false,
        }
    }
}

/// Reads `start_from`. A checkpoint gives its averaged parameters ([`Checkpoint::network`]). If its
/// network differs in NetVLAD only, NetVLAD stays random; if it is a smaller network, the encoder grows from it and the rest
/// stays random; other files are read as weights of torchvision's VGG-16.
fn loaded(
    path: &Path,
    random: Parameters,
    config: &TrainConfig,
    device: &Device,
) -> Result<Loaded, TrainError> {
    let (found, netvlad_initialised) = if Checkpoint::is_checkpoint(path)? {
        let checkpoint = Checkpoint::open(path, device)?;
        (
            checkpoint.network()?.with_classifier(0, device),
            checkpoint.position.centres_started,
        )
    } else {
        match Model::open(path) {
            Ok(model) => (Parameters::of_model(&model, device), true),
            Err(error) if is_of_another_program(&error) => return with_encoder(path, random),
            Err(error) => return Err(error.into()),
        }
    };
    if found.spec() != random.spec() {
        if differs_in_netvlad_only(found.spec(), random.spec()) {
            tracing::info!(
                "{}: NetVLAD of `{}` aggregates other vectors and is not taken from this file",
                path.display(),
                config.network
            );
            return Ok(Loaded::random(with_all_but_netvlad(&found, random)?));
        }
        if let Some(grown) = grow_encoder(&found, random)? {
            tracing::info!(
                "{}: the encoder of `{}` is initialised from this smaller network; the rest is random",
                path.display(),
                config.network
            );
            return Ok(Loaded::random(grown));
        }
        return Err(TrainError::Checkpoint {
            path: path.to_owned(),
            reason: format!(
                "it contains another network than `{}`, and not a smaller one; set `start_from` to a file of this network, or remove it",
                config.network
            ),
        });
    }
    Ok(Loaded {
        parameters: found,
        netvlad_initialised,
        lacks_norms: false,
    })
}

/// Whether a file that cannot be opened as a model was never one.
fn is_of_another_program(error: &NetError) -> bool {
    let NetError::ModelFile { reason, .. } = error else {
        return false;
    };
    matches!(
        reason,
        ModelFileError::NotSafetensors(_) | ModelFileError::MissingMetadata(_)
    )
}

/// Whether two networks are equal but for NetVLAD.
fn differs_in_netvlad_only(one: &NetSpec, other: &NetSpec) -> bool {
    let with_other_vlad = NetSpec {
        vlad: other.vlad,
        ..one.clone()
    };
    with_other_vlad == *other
}

/// The parameters with those of another network except NetVLAD's.
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

/// The parameters with the encoder of torchvision's VGG-16.
fn with_encoder(path: &Path, mut parameters: Parameters) -> Result<Loaded, TrainError> {
    let wrong = |reason: String| TrainError::Weights {
        path: path.to_owned(),
        reason,
    };
    let encoder = encoder_from_torchvision(&read_tensors(path)?).map_err(wrong)?;
    if parameters.spec().stages != NetSpec::vgg16().stages {
        return Err(wrong(
            "torchvision's VGG-16 fits `network = \"vgg16\"` and its variants only".into(),
        ));
    }
    for (name, values) in encoder.tensors {
        parameters.set_from_host(&name, values)?;
    }
    Ok(Loaded {
        lacks_norms: !encoder.has_norms,
        ..Loaded::random(parameters)
    })
}
