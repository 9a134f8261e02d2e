//! What separates a network description from the paper's (Remote Sens. 2026, 18(10), 1477).

use crate::{Decoder, NetSpec};

impl NetSpec {
    /// Whether the encoder is the paper's: VGG-16's five stages (section 3.3.1).
    pub fn has_paper_encoder(&self) -> bool {
        self.stages == Self::vgg16_paper().stages
    }

    /// What separates the description from [`NetSpec::vgg16_paper`], the paper's network as published; empty if nothing does.
    pub fn differences_from_paper(&self) -> Vec<&'static str> {
        let paper = Self::vgg16_paper();
        let decoder = match self.decoder {
            Decoder::Lateral { .. } => {
                "a lateral decoder in place of two transposed convolutions (eq. 4)"
            }
            Decoder::Transposed { .. } => {
                "normalisation and activation after the transposed convolutions (eq. 4 has neither)"
            }
            Decoder::TransposedPlain { .. } => {
                "another width of the transposed convolutions (eq. 4)"
            }
        };
        let vlad = if self.vlad.input.is_deepest() {
            "NetVLAD on features scaled to unit length (eq. 5-6 do not scale)"
        } else {
            "NetVLAD on the local descriptors in place of the deepest features (eq. 5-6)"
        };
        [
            (!self.has_paper_encoder(), "another encoder than VGG-16"),
            (
                (self.input_mean, self.input_std) != (paper.input_mean, paper.input_std),
                "another input normalisation than ImageNet's",
            ),
            (self.decoder != paper.decoder, decoder),
            (
                self.keypoints != paper.keypoints,
                "keypoints not from the decoder (eq. 10)",
            ),
            (
                self.descriptor_dim != paper.descriptor_dim,
                "local descriptors of another length than 256 (eq. 14)",
            ),
            (self.vlad.input != paper.vlad.input, vlad),
            (
                self.vlad.clusters != paper.vlad.clusters,
                "another number of clusters than 64 (eq. 5)",
            ),
            (
                self.global_len() != paper.global_len(),
                "a global descriptor of another length than 512 (eq. 8)",
            ),
        ]
        .into_iter()
        .filter_map(|(differs, what)| differs.then_some(what))
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_preset_says_what_separates_it_from_the_paper() {
        assert!(NetSpec::vgg16_paper().differences_from_paper().is_empty());
        let normalised = NetSpec::vgg16().differences_from_paper();
        assert_eq!(normalised.len(), 2, "{normalised:?}");
        assert!(normalised[0].contains("normalisation and activation"));
        assert!(normalised[1].contains("unit length"));
        assert!(NetSpec::vgg16().has_paper_encoder());
        let lateral = NetSpec::vgg16_lateral().differences_from_paper();
        assert!(lateral.iter().any(|d| d.contains("lateral")), "{lateral:?}");
        let compact = NetSpec::compact();
        assert!(!compact.has_paper_encoder());
        assert_eq!(compact.differences_from_paper().len(), 7);
        let unwhitened = NetSpec {
            global_dim: 0,
            ..NetSpec::vgg16_paper()
        };
        assert_eq!(unwhitened.differences_from_paper().len(), 1);
    }
}
