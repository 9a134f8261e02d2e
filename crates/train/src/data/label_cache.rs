//! The label files of pictures, named by detector, settings and the picture's bytes: changing one of them gives another file, and
//! no picture is labelled twice.

use super::label_options::LabelOptions;
use crate::error::TrainError;
use grimnet_net::ModelHash;
use std::path::{Path, PathBuf};

/// The label files of one detector with one set of options.
#[derive(Clone, Debug)]
pub struct LabelCache {
    folder: PathBuf,
}

/// The first 16 hexadecimal digits.
fn short(hash: blake3::Hash) -> String {
    hash.to_hex()[..16].to_owned()
}

impl LabelCache {
    /// The label files of a detector.
    ///
    /// # Errors
    /// [`TrainError::Labels`] if the options cannot be serialised.
    pub fn new(options: &LabelOptions, detector: ModelHash) -> Result<Self, TrainError> {
        let settings = LabelOptions {
            folder: PathBuf::new(),
            detector: None,
            ..options.clone()
        };
        let settings = serde_json::to_string(&settings).map_err(|error| TrainError::Labels {
            reason: error.to_string(),
        })?;
        let key = blake3::hash(format!("{detector} {settings}").as_bytes());
        Ok(Self {
            folder: options.folder.join(short(key)),
        })
    }

    /// The label file of a picture, which need not exist.
    ///
    /// # Errors
    /// [`TrainError::Io`] if the picture cannot be read.
    pub fn file_of(&self, picture: &Path) -> Result<PathBuf, TrainError> {
        let name = short(blake3::hash(&fs_err::read(picture)?));
        Ok(self.folder.join(format!("{name}.safetensors")))
    }

    /// The error for pictures without labels.
    pub(super) fn incomplete(&self, missing: usize, all: usize) -> TrainError {
        TrainError::Labels {
            reason: format!(
                "{missing} of {all} pictures have no labels by this detector and these settings in {}; label the pictures first",
                self.folder.display()
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detector_settings_and_picture_decide_where_labels_are() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a.png", "b.png"].map(|name| folder.path().join(name));
        std::fs::write(&a, b"one").unwrap();
        std::fs::write(&b, b"two").unwrap();
        let options = LabelOptions::default();
        let file = |options: &LabelOptions, model: u8, picture: &Path| {
            LabelCache::new(options, ModelHash::from_bytes([model; 32]))
                .unwrap()
                .file_of(picture)
                .unwrap()
        };
        let first = file(&options, 1, &a);
        assert!(first.starts_with(&options.folder));
        assert_ne!(first, file(&options, 2, &a));
        assert_ne!(first, file(&options, 1, &b));
        let more = LabelOptions {
            views: 90,
            ..options.clone()
        };
        assert_ne!(first, file(&more, 1, &a));
        let moved = LabelOptions {
            detector: Some("elsewhere.safetensors".into()),
            ..options
        };
        assert_eq!(first, file(&moved, 1, &a));
    }
}
