//! Which network descriptions can be built.

use crate::error::SpecError;
use crate::spec::STAGES;
use crate::{Decoder, KeypointHead, NetError, NetSpec};

/// Most channels of a layer, or clusters, that a description may ask for: a limit against damaged files.
const LARGEST_WIDTH: usize = 8192;
/// Most values of a layer of the encoder per pixel of the image, four times as many as VGG-16's: a limit on memory. Those of the
/// other layers, at 1/8 of the side, are limited by [`LARGEST_WIDTH`] to half of it.
const MOST_PER_PIXEL: usize = 256;
/// Most layers of a stage or of the keypoint head that a description may ask for: a limit against damaged files.
const MOST_LAYERS: usize = 64;

impl NetSpec {
    /// Checks that the network can be built.
    ///
    /// # Errors
    /// [`NetError::Spec`] with the rule that is violated.
    pub fn validate(&self) -> Result<(), NetError> {
        self.check().map_err(NetError::Spec)
    }

    fn check(&self) -> Result<(), SpecError> {
        if self.stages.len() != STAGES {
            return Err(SpecError::Stages {
                found: self.stages.len(),
                expected: STAGES,
            });
        }
        let layers = |part, found: usize, min| {
            if (min..=MOST_LAYERS).contains(&found) {
                return Ok(());
            }
            Err(SpecError::Layers {
                part,
                found,
                min,
                max: MOST_LAYERS,
            })
        };
        for stage in &self.stages {
            layers("a stage", stage.widths.len(), 1)?;
        }
        let (head_width, head_layers) = match self.keypoints {
            KeypointHead::FromGrey { width, layers } => (width, layers),
            KeypointHead::FromDecoder => (1, 0),
        };
        layers("the keypoint head", head_layers, 0)?;
        let stages = self.stages.iter().flat_map(|stage| &stage.widths).copied();
        let heads = [
            self.decoder.width(),
            self.descriptor_dim,
            head_width,
            self.vlad.clusters,
        ];
        if let Some(found) = stages
            .chain(heads)
            .find(|width| !(1..=LARGEST_WIDTH).contains(width))
        {
            return Err(SpecError::Width {
                found,
                max: LARGEST_WIDTH,
            });
        }
        if self.widest_per_pixel() > MOST_PER_PIXEL {
            return Err(SpecError::Activation {
                found: self.widest_per_pixel(),
                max: MOST_PER_PIXEL,
            });
        }
        if let Decoder::Lateral { width } = self.decoder
            && width != self.stage_width(2)
        {
            return Err(SpecError::DecoderWidth {
                decoder: width,
                stage: self.stage_width(2),
            });
        }
        let longest = if self.has_whitening() {
            self.vlad_len().min(2 * LARGEST_WIDTH)
        } else {
            self.vlad_len()
        };
        if self.global_dim > longest {
            return Err(SpecError::GlobalDim {
                found: self.global_dim,
                max: longest,
            });
        }
        let finite = |values: &[f32; 3]| values.iter().all(|v| v.is_finite());
        if !finite(&self.input_mean)
            || !finite(&self.input_std)
            || self.input_std.iter().any(|&v| v <= 0.0)
        {
            return Err(SpecError::InputNormalisation);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_descriptions_are_refused() {
        let refuse = |change: &dyn Fn(&mut NetSpec)| {
            let mut spec = NetSpec::compact();
            change(&mut spec);
            spec.validate().unwrap_err()
        };
        refuse(&|s| s.stages.truncate(4));
        refuse(&|s| s.stages[1].widths.clear());
        refuse(&|s| s.stages[1].widths[0] = usize::MAX);
        // Few weights, and gigabytes for a picture.
        let wide = refuse(&|s| s.stages[0].widths = vec![1, 8192, 1]);
        assert!(matches!(
            wide,
            NetError::Spec(SpecError::Activation { found: 2048, .. })
        ));
        refuse(&|s| s.decoder = Decoder::Lateral { width: 64 });
        refuse(&|s| s.input_std[1] = 0.0);
        refuse(&|s| s.global_dim = 8193);
    }
}
