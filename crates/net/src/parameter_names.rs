//! Names and shapes of a network's tensors, as in the model file.

use crate::parameter::{WHITENING_MEAN, WHITENING_PROJECTION};
use crate::spec::STAGES;
use crate::{Decoder, Domain, KEYPOINT_CELL_PX, KEYPOINT_CLASSES, KeypointHead, NetSpec};

/// One batch normalisation (both domains): the prefix of its tensors' names, and its channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct NormSpec {
    pub name: String,
    pub channels: usize,
}

/// Names and shapes of tensors.
struct List(Vec<(String, Vec<usize>)>);

impl List {
    fn push(&mut self, name: impl Into<String>, shape: &[usize]) {
        self.0.push((name.into(), shape.to_vec()));
    }

    /// The tensors of a layer's normalisation, both domains.
    fn norm(&mut self, layer: &str, channels: usize) {
        for domain in Domain::ALL {
            for part in ["weight", "bias", "mean", "var"] {
                self.push(domain.norm_name(layer, part), &[channels]);
            }
        }
    }
}

impl NetSpec {
    /// Names and shapes of all tensors, in a fixed order. Weights of convolutions are `[out, in, k, k]`, those of transposed
    /// convolutions `[in, out, 4, 4]` (PyTorch's layouts).
    pub fn parameters(&self) -> Vec<(String, Vec<usize>)> {
        let mut list = List(Vec::new());
        let mut channels = 3;
        for (s, stage) in self.stages.iter().enumerate() {
            for (c, &width) in stage.widths.iter().enumerate() {
                list.push(format!("encoder.{s}.{c}.weight"), &[width, channels, 3, 3]);
                list.norm(&format!("encoder.{s}.{c}"), width);
                channels = width;
            }
        }
        self.add_decoder(&mut list);
        let kernel = self.descriptor_kernel();
        list.push(
            "descriptor.weight",
            &[self.descriptor_dim, self.decoder.width(), kernel, kernel],
        );
        list.push("descriptor.bias", &[self.descriptor_dim]);
        self.add_keypoint_head(&mut list);
        let (clusters, dim) = (self.vlad.clusters, self.vlad_dim());
        list.push("netvlad.assign.weight", &[clusters, dim]);
        list.push("netvlad.assign.bias", &[clusters]);
        list.push("netvlad.centres", &[clusters, dim]);
        if self.has_whitening() {
            list.push(WHITENING_MEAN, &[self.vlad_len()]);
            list.push(WHITENING_PROJECTION, &[self.global_dim, self.vlad_len()]);
        }
        list.0
    }

    fn add_decoder(&self, list: &mut List) {
        let transposed = |width| {
            [self.stage_width(STAGES - 1), width]
                .into_iter()
                .enumerate()
        };
        match self.decoder {
            Decoder::Lateral { width } => {
                for (name, stage) in [("lateral.h16", 3), ("lateral.h32", 4)] {
                    list.push(
                        format!("{name}.weight"),
                        &[width, self.stage_width(stage), 1, 1],
                    );
                    list.push(format!("{name}.bias"), &[width]);
                }
                list.push("fuse.weight", &[width, width, 3, 3]);
                list.norm("fuse", width);
            }
            Decoder::Transposed { width } => {
                for (i, from) in transposed(width) {
                    list.push(format!("upsample.{i}.weight"), &[from, width, 4, 4]);
                    list.norm(&format!("upsample.{i}"), width);
                }
            }
            Decoder::TransposedPlain { width } => {
                for (i, from) in transposed(width) {
                    list.push(format!("upsample.{i}.weight"), &[from, width, 4, 4]);
                    list.push(format!("upsample.{i}.bias"), &[width]);
                }
            }
        }
    }

    fn add_keypoint_head(&self, list: &mut List) {
        match self.keypoints {
            KeypointHead::FromGrey { width, layers } => {
                let mut from = (KEYPOINT_CELL_PX * KEYPOINT_CELL_PX) as usize;
                for i in 0..layers {
                    list.push(format!("keypoint.{i}.weight"), &[width, from, 1, 1]);
                    list.norm(&format!("keypoint.{i}"), width);
                    from = width;
                }
                list.push("keypoint.out.weight", &[KEYPOINT_CLASSES, from, 1, 1]);
                list.push("keypoint.out.bias", &[KEYPOINT_CLASSES]);
            }
            KeypointHead::FromDecoder => {
                list.push(
                    "keypoint.weight",
                    &[KEYPOINT_CLASSES, self.decoder.width(), 3, 3],
                );
                list.push("keypoint.bias", &[KEYPOINT_CLASSES]);
            }
        }
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
