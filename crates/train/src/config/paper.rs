//! The paper's training recipe.

use grimnet_net::DataType;

use super::{DescriptorLoss, ExportOptions, GlobalLoss, TrainConfig, Weights, WhiteningChoice};
use crate::data::{HomographyRange, LabelOptions, PairOptions};
use crate::loss::{HingeOptions, TripletOptions};
use crate::run::optimiser::AdamOptions;

/// Processing resolution, pixels (section 4.3: H = W = 320).
const SIDE_PX: u32 = 320;
/// Positions sampled for the descriptor hinge. Eq. 16-17 average over all pairs of positions, which are 10^10; this
/// estimate has 400 corresponding pairs among 160,000, a share of 1/400. Read literally the equation has a share of 1/102,400;
/// SuperPoint, whose loss the paper says it uses, has one of about 1/2 by its weight of 250 and its radius of 8 px, within which three of
/// the 1,600 cells of such a picture lie.
const HINGE_POSITIONS: usize = 400;
/// Range of rotations either way, degrees. The paper says that "the strategy is the same as that of SuperPoint", which gives no
/// number; this is the range of the common reimplementation of SuperPoint.
const ROTATION_DEG: f64 = 90.0;
/// Random homographies of the homographic adaptation (DeTone et al. 2018, section 5.2).
const ADAPTATION_VIEWS: usize = 100;

impl TrainConfig {
    /// The paper's recipe (sections 3.3-3.6 and 4.3): network, resolution, losses with their margins and weights, labels by
    /// homographic adaptation, retrieval and matching in turns from the start, Adam with its default settings and a constant
    /// learning rate, and a tenth of that rate for the encoder.
    ///
    /// The paper does not give batch size, length, the number of hard negatives, or rotation range; those values are this
    /// project's. Data folders and the initial ImageNet weights are for the user to set.
    pub fn paper() -> Self {
        Self {
            network: "vgg16-paper".into(),
            learning_rate: 1e-3,
            encoder_rate: 0.1,
            adam: AdamOptions::pytorch(),
            warmup_steps: 0,
            decay_from: 1.0,
            clip: f32::INFINITY,
            average_decay: 0.0,
            global_from: 0.0,
            alternate: true,
            weights: Weights {
                keypoint: 0.5,
                dustbin: 1.0,
                descriptor: 0.5,
                global: 1.0,
                homography: 0.3,
            },
            descriptor_loss: DescriptorLoss::Hinge,
            hinge: HingeOptions {
                positive_margin: 0.9,
                negative_margin: 0.2,
                positive_weight: 1.0,
            },
            global_loss: GlobalLoss::Triplet,
            triplet: TripletOptions {
                margin: 0.5,
                ..TripletOptions::default()
            },
            labels: Some(LabelOptions {
                views: ADAPTATION_VIEWS,
                side_px: SIDE_PX,
                homography: HomographyRange {
                    rotation_deg: ROTATION_DEG,
                    ..LabelOptions::default().homography
                },
                ..LabelOptions::default()
            }),
            pairs: PairOptions {
                side_px: SIDE_PX,
                points: HINGE_POSITIONS,
                homography: HomographyRange {
                    rotation_deg: ROTATION_DEG,
                    ..HomographyRange::default()
                },
                ..PairOptions::default()
            },
            export: ExportOptions {
                whitening: WhiteningChoice::Pca,
                whitening_pairs: 1100,
                whitening_precision: DataType::F16,
                ..ExportOptions::default()
            },
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::validation::validation_options;
    use grimnet_net::{Decoder, KeypointHead, VladInput};

    /// The values that the paper gives, copied from its text.
    #[test]
    fn the_recipe_has_the_papers_values() {
        let recipe = TrainConfig::paper();
        // Eq. 25 and table 1.
        assert_eq!(recipe.weights.global, 1.0, "alpha");
        assert_eq!(recipe.weights.keypoint, 0.5, "beta 1");
        assert_eq!(recipe.weights.descriptor, 0.5, "beta 2");
        assert_eq!(recipe.weights.homography, 0.3, "gamma");
        assert_eq!(recipe.encoder_rate, 0.1, "1/10 of that of other modules");
        // Eq. 9.
        assert_eq!(recipe.global_loss, GlobalLoss::Triplet);
        assert_eq!(recipe.triplet.margin, 0.5);
        // Eq. 13: every cell counts alike.
        assert_eq!(recipe.weights.dustbin, 1.0);
        // Eq. 17.
        assert_eq!(recipe.descriptor_loss, DescriptorLoss::Hinge);
        assert_eq!(recipe.hinge.positive_margin, 0.9);
        assert_eq!(recipe.hinge.negative_margin, 0.2);
        assert_eq!(recipe.hinge.positive_weight, 1.0);
        // Eq. 24: pixels.
        assert_eq!(recipe.homography.unit_px, 1.0);
        // Section 4.3.
        assert_eq!(recipe.pairs.side_px, 320);
        assert!(recipe.alternate);
        assert_eq!(recipe.global_from, 0.0);
        // "The optimizer was Adam", in PyTorch 2.0.1: its defaults.
        assert_eq!(recipe.learning_rate, 1e-3);
        assert_eq!((recipe.adam.beta1, recipe.adam.beta2), (0.9, 0.999));
        assert_eq!(recipe.adam.epsilon, 1e-8);
        assert_eq!((recipe.warmup_steps, recipe.decay_from), (0, 1.0));
        assert_eq!(recipe.clip, f32::INFINITY);
        assert_eq!(recipe.average_decay, 0.0);
        // Section 3.5.1: labels as SuperPoint's, by homographic adaptation; threshold as at inference.
        let labels = recipe.labels.as_ref().unwrap();
        assert_eq!(labels.threshold, 0.015);
        assert_eq!(labels.views, 100);
        assert_eq!(labels.homography.rotation_deg, 90.0, "as of the pairs");
        // Section 3.3: VGG-16, five poolings, 13 convolutions; two transposed convolutions of 512 channels; 64 clusters on the
        // deepest features; 512 values after whitening.
        let network = recipe.spec().unwrap();
        let layers: Vec<usize> = network.stages.iter().map(|s| s.widths.len()).collect();
        assert_eq!(layers, [2, 2, 3, 3, 3]);
        assert_eq!(network.decoder, Decoder::TransposedPlain { width: 512 });
        assert_eq!(network.keypoints, KeypointHead::FromDecoder);
        assert_eq!(network.descriptor_dim, 256);
        assert_eq!(network.vlad.input, VladInput::DeepestUnscaled);
        assert_eq!((network.vlad.clusters, network.global_dim), (64, 512));
        // Eq. 8: a PCA whitening matrix, whatever it measures, fitted to descriptors of the resolution of section 4.3.
        assert_eq!(recipe.export.whitening, WhiteningChoice::Pca);
        assert_eq!(validation_options(&recipe.pairs).side_px, 320);
    }

    #[test]
    fn the_preset_file_is_the_recipe() {
        let preset: TrainConfig = toml::from_str(include_str!("../../presets/paper.toml")).unwrap();
        assert_eq!(preset, TrainConfig::paper());
    }
}
