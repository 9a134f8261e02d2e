//! NetVLAD started from clusters of local descriptors (Arandjelovic et al. 2016, section 3.2), by
//! spherical k-means.

use crate::TrainError;
use crate::parameters::{Parameters, host};
use burn::tensor::Tensor;
use grimnet_net::KMeans;

/// Iterations of k-means.
const ITERATIONS: usize = 12;
/// The assignment's weights are the centres times this: a soft assignment by cosine.
const SHARPNESS: f32 = 20.0;

/// Sets NetVLAD's centres and assignment from vectors `[n, dim]`, unit rows.
///
/// # Errors
/// Where the device does not give the vectors back.
pub fn start_centres(
    parameters: &mut Parameters,
    vectors: Tensor<2>,
    seed: u64,
) -> Result<(), TrainError> {
    let dim = vectors.dims()[1];
    let clusters = parameters.spec().vlad.clusters;
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
