//! What a new run starts with: random numbers, or those of a model or of another run.

use crate::TrainError;
use crate::checkpoint::{Checkpoint, Position};
use crate::config::TrainConfig;
use crate::optimiser::Adam;
use crate::parameters::Parameters;
use burn::tensor::Device;
use grimnet_net::Model;
use std::path::Path;

/// The first state of a run.
///
/// # Errors
/// `start_from` that cannot be read, or holds another network.
pub(crate) fn first_state(config: &TrainConfig, device: &Device) -> Result<Checkpoint, TrainError> {
    let random = Parameters::of_model(&Model::random(&config.spec()?, config.seed)?, device);
    let mut position = Position::default();
    let parameters = match &config.start_from {
        None => random,
        Some(path) => {
            let found = numbers_of(path, device)?;
            if found.spec() != random.spec() {
                return Err(TrainError::Checkpoint {
                    path: path.clone(),
                    reason: format!(
                        "it holds another network than `{}`; leave `start_from` out, or name a file of this network",
                        config.network
                    ),
                });
            }
            position.centres_started = true;
            found
        }
    };
    Ok(Checkpoint {
        average: parameters.clone(),
        parameters,
        adam: Adam::default(),
        position,
    })
}

/// The averaged numbers of a checkpoint, or the numbers of a model file.
fn numbers_of(path: &Path, device: &Device) -> Result<Parameters, TrainError> {
    match Checkpoint::open(path, device) {
        Ok(checkpoint) => Ok(checkpoint.average),
        Err(error @ TrainError::Io(_)) => Err(error),
        Err(_) => Ok(Parameters::of_model(&Model::open(path)?, device)),
    }
}
