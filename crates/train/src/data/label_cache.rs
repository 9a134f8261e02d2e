//! Where the labels of each picture are kept: by detector, settings and the picture's bytes, so that none of them can change
//! unnoticed and the same work is never done twice.

use super::label_options::LabelOptions;
use crate::TrainError;
use grimnet_net::ModelHash;
use std::path::{Path, PathBuf};

/// The labels by one detector under one set of options.
#[derive(Clone, Debug)]
pub struct LabelCache {
    folder: PathBuf,
}

/// The first sixteen hexadecimal digits are enough for the files of a folder.
fn short(hash: blake3::Hash) -> String {
    hash.to_hex()[..16].to_owned()
}

impl LabelCache {
    /// The cache of a detector.
    ///
    /// # Errors
    /// [`TrainError::Labels`] where the options cannot be written down.
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

    /// The file for a picture's labels, whether it exists or not.
    ///
    /// # Errors
    /// [`TrainError::Io`] where the picture cannot be read.
    pub fn file_of(&self, picture: &Path) -> Result<PathBuf, TrainError> {
        let name = short(blake3::hash(&fs_err::read(picture)?));
        Ok(self.folder.join(format!("{name}.safetensors")))
    }

    /// Says that labels are missing, and how to make them.
    pub(super) fn incomplete(&self, missing: usize, all: usize) -> TrainError {
        TrainError::Labels {
            reason: format!(
                "{missing} of {all} pictures have none by this detector and these settings in {}; make them with: grim train CONFIG --labels",
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
