//! Initialising NetVLAD from clusters of the vectors that it aggregates (Arandjelovic et al. 2016, section 3.2).

use crate::error::TrainError;
use crate::model::parameters::{Parameters, host};
use burn::tensor::Tensor;
use grimnet_net::KMeans;

/// Iterations of k-means.
const ITERATIONS: usize = 12;
/// The assignment weights are the centres multiplied by this factor.
const SHARPNESS: f32 = 20.0;

/// Sets NetVLAD's centres and assignment by spherical k-means.
///
/// # Shapes
/// `vectors` `[n, dim]`, rows of unit length.
///
/// # Errors
/// Returns an error if there are fewer vectors than clusters, or values cannot be read from the device.
pub(crate) fn init_netvlad(
    parameters: &mut Parameters,
    vectors: Tensor<2>,
    seed: u64,
) -> Result<(), TrainError> {
    let [count, dim] = vectors.dims();
    let clusters = parameters.spec().vlad.clusters;
    if count < clusters {
        return Err(TrainError::Config {
            reason: format!(
                "NetVLAD's {clusters} clusters cannot be initialised from {count} vectors; raise `pairs_per_step` or `pairs.side_px`"
            ),
        });
    }
    let k_means = KMeans {
        clusters,
        iterations: ITERATIONS,
        spherical: true,
        seed,
    };
    let centres = k_means.run(&host(vectors)?, dim);
    let sharp = centres.iter().map(|v| v * SHARPNESS).collect();
    parameters.set_from_host("netvlad.assign.weight", sharp)?;
    parameters.set_from_host("netvlad.assign.bias", vec![0.0; clusters])?;
    parameters.set_from_host("netvlad.centres", centres)
}
