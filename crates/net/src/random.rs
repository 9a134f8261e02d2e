//! Networks with random weights, to build, test and time them; they cannot localise.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{Card, Model, NetError, NetSpec};

/// Sharpness of a random NetVLAD's soft assignment, similar to that of a layer initialised by k-means.
const ASSIGNMENT_SHARPNESS: f32 = 20.0;

impl Model {
    /// A network with random weights: convolutions after He et al. 2015 (uniform, variance 2 / fan-in), identity
    /// normalisation, NetVLAD centres of unit length. Its card says that it is random. The same seed gives the same model.
    ///
    /// # Errors
    /// [`NetError::Spec`] if the network cannot be built.
    pub fn random(spec: &NetSpec, seed: u64) -> Result<Self, NetError> {
        spec.validate()?;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut centres: Vec<f32> = uniform(&mut random, spec.vlad_len(), 1.0);
        for row in centres.chunks_exact_mut(spec.vlad_dim()) {
            let norm = row
                .iter()
                .map(|v| v * v)
                .sum::<f32>()
                .sqrt()
                .max(f32::MIN_POSITIVE);
            row.iter_mut().for_each(|v| *v /= norm);
        }
        let mut values = Vec::new();
        for (name, shape) in spec.parameters() {
            let len = shape.iter().product();
            let numbers = match name.as_str() {
                "netvlad.assign.weight" => {
                    centres.iter().map(|v| v * ASSIGNMENT_SHARPNESS).collect()
                }
                "netvlad.centres" => centres.clone(),
                "whitening.projection" => {
                    uniform(&mut random, len, (3.0 / spec.global_dim as f32).sqrt())
                }
                _ if shape.len() == 4 => {
                    // A 4 x 4 transposed convolution with stride 2 sums a quarter of its taps at each position.
                    let fan_in = if name.starts_with("upsample") {
                        shape[0] * 4
                    } else {
                        shape[1] * shape[2] * shape[3]
                    };
                    uniform(&mut random, len, (6.0 / fan_in as f32).sqrt())
                }
                _ if name.ends_with(".var") || name.ends_with(".weight") => vec![1.0; len],
                _ => vec![0.0; len],
            };
            values.push((name, numbers));
        }
        let card = Card {
            name: format!("{}, random (seed {seed})", spec.preset),
            training_data: "none".into(),
            licence: "MIT OR Apache-2.0".into(),
            notes: "Random weights, to build, test and time the program. It cannot localise."
                .into(),
            random: true,
            ..Card::default()
        };
        Self::from_values(spec.clone(), card, values)
    }
}

fn uniform(random: &mut ChaCha8Rng, len: usize, bound: f32) -> Vec<f32> {
    (0..len)
        .map(|_| random.random_range(-bound..bound))
        .collect()
}

/// A `compact` network with narrow layers, for quick tests.
#[cfg(test)]
pub(crate) fn tiny_compact() -> NetSpec {
    use crate::{Decoder, KeypointHead, Vlad, VladInput};
    let mut spec = NetSpec::compact();
    for (stage, width) in spec.stages.iter_mut().zip([4, 8, 16, 16, 24]) {
        stage.widths = vec![width, width];
    }
    spec.decoder = Decoder::Lateral { width: 16 };
    spec.descriptor_dim = 24;
    spec.keypoints = KeypointHead::FromGrey {
        width: 16,
        layers: 2,
    };
    spec.vlad = Vlad {
        input: VladInput::Descriptors,
        clusters: 6,
    };
    spec.global_dim = 32;
    spec
}

/// A `vgg16` network with narrow layers, for quick tests.
#[cfg(test)]
pub(crate) fn tiny_vgg16() -> NetSpec {
    use crate::{Decoder, Vlad, VladInput};
    let mut spec = NetSpec::vgg16();
    for (stage, width) in spec.stages.iter_mut().zip([4, 8, 8, 16, 24]) {
        stage.widths.fill(width);
    }
    spec.decoder = Decoder::Transposed { width: 16 };
    spec.descriptor_dim = 24;
    spec.vlad = Vlad {
        input: VladInput::Deepest,
        clusters: 6,
    };
    spec.global_dim = 32;
    spec
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_decides_everything_and_the_card_says_random() {
        let spec = tiny_compact();
        let model = Model::random(&spec, 1).unwrap();
        assert_eq!(model.hash(), Model::random(&spec, 1).unwrap().hash());
        assert_ne!(model.hash(), Model::random(&spec, 2).unwrap().hash());
        assert!(model.is_random() && model.card().notes.contains("cannot localise"));
        assert!(Model::random(&tiny_vgg16(), 1).unwrap().is_random());
    }
}
