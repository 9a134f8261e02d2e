//! NetVLAD started from clusters of local descriptors (Arandjelovic et al. 2016, section 3.2), by spherical k-means.

use crate::TrainError;
use crate::parameters::{Parameters, host};
use burn::tensor::Tensor;
use rand::SeedableRng;
use rand::seq::SliceRandom;

/// Rounds of k-means.
const ROUNDS: usize = 12;
/// The assignment's weights are the centres times this: a soft assignment by cosine.
const SHARPNESS: f32 = 20.0;

/// Cluster centres of unit vectors, `[clusters, dim]`; seeded.
pub fn unit_clusters(vectors: &[f32], dim: usize, clusters: usize, seed: u64) -> Vec<f32> {
    let count = vectors.len() / dim;
    let mut order: Vec<usize> = (0..count).collect();
    order.shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(seed));
    let row = |i: usize| &vectors[i * dim..(i + 1) * dim];
    let mut centres: Vec<f32> = (0..clusters)
        .flat_map(|k| row(order[k % count.max(1)]).to_vec())
        .collect();
    for _ in 0..ROUNDS {
        let mut sums = vec![0.0f32; clusters * dim];
        for i in 0..count {
            let v = row(i);
            let dot = |c: &[f32]| c.iter().zip(v).map(|(a, b)| a * b).sum::<f32>();
            let best = centres.chunks_exact(dim).map(dot).enumerate().fold(
                (0, f32::MIN),
                |best, (k, s)| if s > best.1 { (k, s) } else { best },
            );
            sums[best.0 * dim..(best.0 + 1) * dim]
                .iter_mut()
                .zip(v)
                .for_each(|(s, v)| *s += v);
        }
        for (centre, sum) in centres.chunks_exact_mut(dim).zip(sums.chunks_exact(dim)) {
            let length = sum.iter().map(|v| v * v).sum::<f32>().sqrt();
            if length > 0.0 {
                centre
                    .iter_mut()
                    .zip(sum)
                    .for_each(|(c, s)| *c = s / length);
            }
        }
    }
    centres
}

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
    let centres = unit_clusters(&host(vectors)?, dim, clusters, seed);
    let sharp = centres.iter().map(|v| v * SHARPNESS).collect();
    parameters.set_from_host("netvlad.assign.weight", sharp)?;
    parameters.set_from_host("netvlad.assign.bias", vec![0.0; clusters])?;
    parameters.set_from_host("netvlad.centres", centres)
}
