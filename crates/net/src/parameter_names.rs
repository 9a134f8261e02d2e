//! Names and shapes of a network's tensors, as in the model file.

use crate::spec::STAGES;
use crate::{Decoder, Domain, KEYPOINT_CELL_PX, KEYPOINT_CLASSES, KeypointHead, NetSpec};

/// One batch normalisation (both domains): the prefix of its tensors' names, and its channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NormSpec {
    pub name: String,
    pub channels: usize,
}

impl NetSpec {
    /// Names and shapes of all tensors, in a fixed order. Weights of convolutions are `[out, in, k, k]`, those of transposed
    /// convolutions `[in, out, 4, 4]` (PyTorch's layouts).
    pub fn parameters(&self) -> Vec<(String, Vec<usize>)> {
        let mut all = Vec::new();
        let mut push = |name: String, shape: &[usize]| all.push((name, shape.to_vec()));
        let norm = |push: &mut dyn FnMut(String, &[usize]), layer: &str, channels: usize| {
            for domain in Domain::ALL {
                for part in ["weight", "bias", "mean", "var"] {
                    push(domain.norm_name(layer, part), &[channels]);
                }
            }
        };
        let mut channels = 3;
        for (s, stage) in self.stages.iter().enumerate() {
            for (c, &width) in stage.widths.iter().enumerate() {
                push(format!("encoder.{s}.{c}.weight"), &[width, channels, 3, 3]);
                norm(&mut push, &format!("encoder.{s}.{c}"), width);
                channels = width;
            }
        }
        match self.decoder {
            Decoder::Lateral { width } => {
                for (name, stage) in [("lateral.h16", 3), ("lateral.h32", 4)] {
                    push(
                        format!("{name}.weight"),
                        &[width, self.stage_width(stage), 1, 1],
                    );
                    push(format!("{name}.bias"), &[width]);
                }
                push("fuse.weight".into(), &[width, width, 3, 3]);
                norm(&mut push, "fuse", width);
            }
            Decoder::Transposed { width } => {
                for (i, from) in [self.stage_width(STAGES - 1), width]
                    .into_iter()
                    .enumerate()
                {
                    push(format!("upsample.{i}.weight"), &[from, width, 4, 4]);
                    norm(&mut push, &format!("upsample.{i}"), width);
                }
            }
            Decoder::TransposedPlain { width } => {
                for (i, from) in [self.stage_width(STAGES - 1), width]
                    .into_iter()
                    .enumerate()
                {
                    push(format!("upsample.{i}.weight"), &[from, width, 4, 4]);
                    push(format!("upsample.{i}.bias"), &[width]);
                }
            }
        }
        let kernel = self.descriptor_kernel();
        push(
            "descriptor.weight".into(),
            &[self.descriptor_dim, self.decoder.width(), kernel, kernel],
        );
        push("descriptor.bias".into(), &[self.descriptor_dim]);
        match self.keypoints {
            KeypointHead::FromGrey { width, layers } => {
                let mut from = (KEYPOINT_CELL_PX * KEYPOINT_CELL_PX) as usize;
                for i in 0..layers {
                    push(format!("keypoint.{i}.weight"), &[width, from, 1, 1]);
                    norm(&mut push, &format!("keypoint.{i}"), width);
                    from = width;
                }
                push(
                    "keypoint.out.weight".into(),
                    &[KEYPOINT_CLASSES, from, 1, 1],
                );
                push("keypoint.out.bias".into(), &[KEYPOINT_CLASSES]);
            }
            KeypointHead::FromDecoder => {
                push(
                    "keypoint.weight".into(),
                    &[KEYPOINT_CLASSES, self.decoder.width(), 3, 3],
                );
                push("keypoint.bias".into(), &[KEYPOINT_CLASSES]);
            }
        }
        let (clusters, dim) = (self.vlad.clusters, self.vlad_dim());
        push("netvlad.assign.weight".into(), &[clusters, dim]);
        push("netvlad.assign.bias".into(), &[clusters]);
        push("netvlad.centres".into(), &[clusters, dim]);
        if self.has_whitening() {
            push("whitening.mean".into(), &[self.vlad_len()]);
            push(
                "whitening.projection".into(),
                &[self.global_dim, self.vlad_len()],
            );
        }
        all
    }

    /// All batch normalisations, in the order of [`NetSpec::parameters`].
    pub(crate) fn norms(&self) -> Vec<NormSpec> {
        let norm = |(name, shape): (String, Vec<usize>)| {
            let (layer, part) = Domain::Sat.norm_of(&name)?;
            (part == "mean").then(|| NormSpec {
                name: layer.to_owned(),
                channels: shape.first().copied().unwrap_or(0),
            })
        };
        self.parameters().into_iter().filter_map(norm).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_normalisation_tensors_round_trip() {
        assert_eq!(
            Domain::Uav.norm_name("encoder.2.0", "var"),
            "encoder.2.0.norm.uav.var"
        );
        for domain in Domain::ALL {
            let all = NetSpec::compact().parameters();
            let found: Vec<_> = all
                .iter()
                .filter_map(|(name, _)| Some((name, domain.norm_of(name)?)))
                .collect();
            assert_eq!(found.len(), 4 * NetSpec::compact().norms().len());
            for (name, (layer, part)) in found {
                assert_eq!(&domain.norm_name(layer, part), name);
            }
        }
    }

    #[test]
    fn parameter_names_are_unique() {
        for spec in NetSpec::presets() {
            let mut names: Vec<_> = spec
                .parameters()
                .into_iter()
                .map(|(name, _)| name)
                .collect();
            let all = names.len();
            names.sort();
            names.dedup();
            assert_eq!(names.len(), all);
            assert!(names.contains(&"netvlad.centres".to_owned()));
        }
    }
}
