//! The file of a picture's keypoint labels.

use crate::error::TrainError;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::path::Path;

/// Keypoints of a picture for each level of its pyramid, the strongest first: x and y in pixels of the whole picture (pixel
/// centres at integers), and the mean probability of the detector.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Labels {
    /// By level, the picture itself first.
    pub levels: Vec<Vec<[f32; 3]>>,
}

fn level_name(level: usize) -> String {
    format!("level.{level}")
}

impl Labels {
    /// Writes the file atomically: a tensor `level.N` of n x 3 values for each level.
    ///
    /// # Errors
    /// [`TrainError::Io`], [`TrainError::Labels`].
    pub fn save(&self, path: &Path) -> Result<(), TrainError> {
        let bytes: Vec<Vec<u8>> = self
            .levels
            .iter()
            .map(|points| {
                points
                    .iter()
                    .flatten()
                    .flat_map(|v| v.to_le_bytes())
                    .collect()
            })
            .collect();
        let views: Vec<(String, TensorView<'_>)> = bytes
            .iter()
            .zip(&self.levels)
            .enumerate()
            .map(|(level, (bytes, points))| {
                let view = TensorView::new(Dtype::F32, vec![points.len(), 3], bytes)?;
                Ok((level_name(level), view))
            })
            .collect::<Result<_, safetensors::SafeTensorError>>()
            .map_err(|error| wrong(path, &error))?;
        let file = safetensors::serialize(views, None).map_err(|error| wrong(path, &error))?;
        crate::output::write_file(path, &file)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`TrainError::Io`]; [`TrainError::Labels`] if the file is damaged.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let bytes = fs_err::read(path)?;
        let tensors = SafeTensors::deserialize(&bytes).map_err(|error| wrong(path, &error))?;
        let levels = (0..tensors.len())
            .map(|level| {
                let tensor = tensors.tensor(&level_name(level))?;
                let values = tensor.data().as_chunks::<4>().0.iter();
                let values: Vec<f32> = values.map(|b| f32::from_le_bytes(*b)).collect();
                Ok(values.as_chunks::<3>().0.to_vec())
            })
            .collect::<Result<_, safetensors::SafeTensorError>>()
            .map_err(|error| wrong(path, &error))?;
        Ok(Self { levels })
    }

    /// The points without their probabilities.
    pub fn into_points(self) -> Vec<Vec<[f32; 2]>> {
        let places = |points: Vec<[f32; 3]>| points.into_iter().map(|[x, y, _]| [x, y]).collect();
        self.levels.into_iter().map(places).collect()
    }
}

fn wrong(path: &Path, error: &safetensors::SafeTensorError) -> TrainError {
    TrainError::Labels {
        reason: format!(
            "{}: {error}; delete the file and label the picture again",
            path.display()
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_come_back_and_half_a_file_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("some/where.safetensors");
        let labels = Labels {
            levels: vec![vec![[1.25, 7.0, 0.5], [3.0, 4.5, 0.25]], vec![]],
        };
        labels.save(&path).unwrap();
        assert_eq!(Labels::open(&path).unwrap(), labels);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 3]).unwrap();
        let error = Labels::open(&path).unwrap_err().to_string();
        assert!(error.contains("where.safetensors"), "{error}");
    }
}
