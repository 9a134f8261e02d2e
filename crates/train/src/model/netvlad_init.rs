//! Initialising NetVLAD from clusters of the vectors that it aggregates (Arandjelovic et al. 2016, section 3.2).

use crate::error::TrainError;
use crate::model::parameters::{Parameters, host};
use burn::tensor::Tensor;
use grimnet_net::KMeans;

/// Iterations of k-means.
const ITERATIONS: usize = 12;
/// Sharpness of the soft assignment: the assignment weights are the centres multiplied by this factor, for vectors of unit
/// length.
const SHARPNESS: f32 = 20.0;

/// Sets NetVLAD's centres and assignment by k-means, spherical if it scales its input to unit length.
///
/// # Shapes
/// `vectors` `[n, dim]`: what NetVLAD aggregates, with rows of unit length if it scales them.
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
    let scaled = parameters.spec().vlad.input.is_scaled();
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
        spherical: scaled,
        seed,
    };
    let vectors = host(vectors)?;
    let centres = k_means.run(&vectors, dim);
    let (weight, bias) = if scaled {
        let weight = centres.iter().map(|v| v * SHARPNESS).collect();
        (weight, vec![0.0; clusters])
    } else {
        // softmax(-a |x - c|^2) = softmax(2 a c x - a |c|^2), with `a` relative to the mean squared length.
        let squares: f32 = vectors.iter().map(|v| v * v).sum();
        let a = 0.5 * SHARPNESS * count as f32 / squares.max(f32::MIN_POSITIVE);
        let square = |c: &[f32]| c.iter().map(|v| v * v).sum::<f32>();
        let bias = centres.chunks_exact(dim).map(|c| -a * square(c)).collect();
        (centres.iter().map(|v| 2.0 * a * v).collect(), bias)
    };
    parameters.set_from_host("netvlad.assign.weight", weight)?;
    parameters.set_from_host("netvlad.assign.bias", bias)?;
    parameters.set_from_host("netvlad.centres", centres)
}
