//! A trained network as keypoint detector.

use crate::data::{Detect, View};
use crate::error::TrainError;
use crate::model::input::InputBuilder;
use crate::model::network::Network;
use crate::model::normalisation::Statistics;
use crate::model::parameters::{Parameters, host};
use crate::run::checkpoint::Checkpoint;
use burn::tensor::Device;
use burn::tensor::activation::softmax;
use grimnet_net::{Model, ModelHash};
use std::path::Path;

/// Pixels of a cell: its keypoint classes without "no keypoint".
const CELL_PIXELS: usize = 64;

/// The keypoint head of a network with the layers below it.
pub struct Detector {
    parameters: Parameters,
    device: Device,
    hash: ModelHash,
}

impl Detector {
    /// The network of a model file or of a checkpoint; the bundled model if `path` is `None`.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or is neither.
    pub fn open(path: Option<&Path>, device: &Device) -> Result<Self, TrainError> {
        let model = match path {
            None => Model::bundled()?,
            Some(path) if Checkpoint::is_checkpoint(path)? => {
                Checkpoint::open(path, device)?.model()?
            }
            Some(path) => Model::open(path)?,
        };
        let device = device.clone().without_autodiff();
        Ok(Self {
            parameters: Parameters::of_model(&model, &device),
            hash: model.hash(),
            device,
        })
    }

    /// Hash of the network.
    pub fn hash(&self) -> ModelHash {
        self.hash
    }
}

impl Detect for Detector {
    fn probabilities(&self, views: &[View]) -> Result<Vec<Vec<f32>>, TrainError> {
        let Some(side) = views.first().map(|view| view.image.width() as usize) else {
            return Ok(Vec::new());
        };
        let mut builder = InputBuilder::new(self.parameters.spec(), side, side);
        for view in views {
            builder.push(&view.image, Some(&view.seen), view.domain);
        }
        let input = builder.finish(&self.device);
        let logits = Network::new(&self.parameters, Statistics::Running).keypoints(&input)?;
        let classes = logits.dims()[1];
        let shares = host(softmax(logits, 1))?;
        let a_view = (side / 8).pow(2) * classes;
        Ok(shares
            .chunks_exact(a_view)
            .map(|cells| pixel_shuffle(cells, classes, side))
            .collect())
    }
}

/// Rearranges the classes of cells to pixels, row by row (pixel shuffle).
fn pixel_shuffle(cells: &[f32], classes: usize, side: usize) -> Vec<f32> {
    let mut pixels = vec![0.0; side * side];
    for (cell, shares) in cells.chunks_exact(classes).enumerate() {
        let (cy, cx) = (cell / (side / 8), cell % (side / 8));
        for (y, row) in shares[..CELL_PIXELS].chunks_exact(8).enumerate() {
            let at = (cy * 8 + y) * side + cx * 8;
            pixels[at..at + 8].copy_from_slice(row);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimnet_net::{Domain, Extractor, NetSpec};
    use image::RgbImage;

    /// The keypoint heads of all presets, compared with the inference engine.
    #[test]
    fn probabilities_are_the_engines() {
        let image = RgbImage::from_fn(64, 64, |x, y| {
            image::Rgb([(x * 3) as u8, (y * 4) as u8, ((x / 7 + y / 5) * 40) as u8])
        });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        for spec in NetSpec::presets() {
            let model = Model::random(&spec, 3).unwrap();
            model.save(&path).unwrap();
            let detector = Detector::open(Some(&path), &Device::flex()).unwrap();
            assert_eq!(detector.parameters.spec().preset, spec.preset);
            let views = Domain::ALL.map(|domain| View {
                image: image.clone(),
                seen: vec![true; 64],
                domain,
            });
            for (found, domain) in detector
                .probabilities(&views)
                .unwrap()
                .iter()
                .zip(Domain::ALL)
            {
                let engine = Extractor::new(&model, domain).unwrap();
                let dense = engine.dense(&image, None).unwrap();
                for (a, b) in found.iter().zip(dense.heatmap()) {
                    assert!((a - b).abs() < 1e-4, "{a} {b}");
                }
            }
        }
    }
}
