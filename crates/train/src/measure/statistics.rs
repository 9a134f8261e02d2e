//! The batch-normalisation statistics of exported parameters.

use crate::config::TrainConfig;
use crate::data::{Sources, batch_of, usable};
use crate::error::TrainError;
use crate::model::input::input_of;
use crate::model::network::Network;
use crate::model::normalisation::{Statistics, share_norms};
use crate::model::parameters::Parameters;
use burn::tensor::Device;

/// Number of batches that the statistics are computed from.
const STATISTICS_BATCHES: u64 = 24;

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
    for i in 0..batches {
        let batch = batch_of(
            sources,
            None,
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
