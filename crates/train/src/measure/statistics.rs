//! The batch-normalisation statistics of exported parameters.

use crate::config::TrainConfig;
use crate::data::{Sources, Task, batch_of, usable};
use crate::error::TrainError;
use crate::model::input::input_of;
use crate::model::network::Network;
use crate::model::normalisation::{Statistics, share_norms};
use crate::model::parameters::Parameters;
use burn::tensor::Device;

/// Number of batches that the statistics are computed from.
const STATISTICS_BATCHES: u64 = 24;

/// The tasks whose pairs the batches have in turns, as in training: those that a loss with a weight trains; `None` for pairs of all.
fn tasks_in_turns(config: &TrainConfig) -> Vec<Option<Task>> {
    let weights = &config.weights;
    let teacher = config.teacher.as_ref();
    // In the steps of both tasks.
    let is_taught = teacher.is_some_and(|of| of.keypoint > 0.0 || of.descriptor > 0.0);
    let matching = [weights.keypoint, weights.descriptor, weights.homography];
    let mut out = Vec::new();
    if config.alternate && (is_taught || matching.iter().any(|weight| *weight > 0.0)) {
        out.push(Some(Task::Matching));
    }
    if config.alternate && (is_taught || config.trains_global_descriptor()) {
        out.push(Some(Task::Retrieval));
    }
    if out.is_empty() {
        out.push(None);
    }
    out
}

/// The averaged parameters with the batch-normalisation statistics that they are exported with: recomputed from training pairs,
/// for averaged parameters need their own, or the running statistics of training if nothing was averaged (`average_decay` = 0).
///
/// # Errors
/// Returns an error if the sources give no pairs, or values cannot be read from the device.
pub fn with_export_statistics(
    average: &Parameters,
    sources: &Sources,
    config: &TrainConfig,
    device: &Device,
) -> Result<Parameters, TrainError> {
    let mut parameters = average.clone();
    let device = device.clone().without_autodiff();
    let batches = if config.average_decay > 0.0 {
        STATISTICS_BATCHES
    } else {
        0
    };
    let tasks = tasks_in_turns(config);
    for (i, task) in (0..batches).zip(tasks.into_iter().cycle()) {
        let batch = batch_of(
            sources,
            task,
            &config.pairs,
            config.pairs_per_step,
            config.seed ^ 0x57a7,
            i,
        );
        let batch = usable(batch, i)?;
        let input = input_of(&batch, parameters.spec(), config.norms, &device);
        let mut network = Network::new(&parameters, Statistics::Batch);
        network.forward(&input, false)?;
        for (name, value) in network.into_running() {
            parameters.set(&name, value)?;
        }
    }
    share_norms(&mut parameters, config.norms)?;
    Ok(parameters)
}
