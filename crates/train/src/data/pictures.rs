//! The pictures of data folders.

use super::label_cache::LabelCache;
use super::labels::Labels;
use super::layout::{Fold, Folder, Listed, files_of};
use super::picture::Picture;
use super::picture_file;
use super::scene::Scene;
use crate::error::TrainError;
use grimnet_limits::PhotoLimits;
use rayon::prelude::*;
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// One picture in this many is held out.
const VALIDATION_ONE_IN: u64 = 20;
/// Size of the cache of decoded pictures, bytes; pictures beyond it are decoded each time.
const CACHE_BYTES: usize = 1_200_000_000;

struct Entry {
    path: PathBuf,
    fold: Fold,
    /// Length of the shorter side.
    side_px: u32,
    scene: Option<Scene>,
    /// File of its keypoint labels, if it has some.
    labels: Option<PathBuf>,
}

/// A set of pictures.
#[derive(Default)]
pub struct Pictures {
    entries: Vec<Entry>,
    /// Indices into the entries, each repeated by its weight.
    training: Vec<usize>,
    validation: Vec<usize>,
    unreadable: usize,
    /// Limits on each picture.
    limits: PhotoLimits,
    scenes: usize,
    /// Added to an index to number the pictures of several sets through.
    first_place: usize,
    cache: Mutex<(HashMap<usize, Arc<Picture>>, usize)>,
}

/// The held-out pictures of a set.
pub struct HeldOut(pub Arc<Pictures>);

/// FNV-1a hash, the same on every machine.
fn hash_of(path: &str) -> u64 {
    path.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The fold of a picture without a publisher's split. It depends on the path below the folder, so that moving the folder does
/// not move pictures between the folds.
fn drawn_fold(path: &Path, folder: &Folder) -> Fold {
    let inside = path.strip_prefix(&folder.path).unwrap_or(path);
    if hash_of(&inside.to_string_lossy()).is_multiple_of(VALIDATION_ONE_IN) {
        Fold::Validation
    } else {
        Fold::Training
    }
}

impl Pictures {
    /// Lists the pictures of the folders. Pictures whose header cannot be read, that need more memory than the limits, or whose
    /// shorter side is below `least_side_px`, are skipped and counted.
    ///
    /// # Errors
    /// [`TrainError::Io`] if a folder cannot be read, [`TrainError::TooFewPictures`] if fewer than eight pictures remain.
    pub fn scan(
        folders: &[Folder],
        least_side_px: u32,
        limits: PhotoLimits,
    ) -> Result<Self, TrainError> {
        let mut out = Self {
            limits,
            ..Self::default()
        };
        for folder in folders {
            out.add_folder(folder, least_side_px)?;
        }
        if out.training.len() < 8 {
            return Err(TrainError::TooFewPictures {
                found: out.training.len(),
                unreadable: out.unreadable,
                folders: folders
                    .iter()
                    .map(|f| f.path.display().to_string())
                    .collect::<Vec<_>>()
                    .join(", "),
                needed: 8,
            });
        }
        Ok(out)
    }

    fn add_folder(&mut self, folder: &Folder, least_side_px: u32) -> Result<(), TrainError> {
        let files = files_of(folder)?;
        let classes: BTreeSet<&String> = files.iter().flat_map(|file| &file.class).collect();
        let among = self.scenes..self.scenes + classes.len();
        self.scenes = among.end;
        let numbers: HashMap<&String, usize> = classes.into_iter().zip(among.clone()).collect();
        let mut small = 0;
        for Listed { path, fold, class } in &files {
            let (width, height) = match picture_file::size_px(path, self.limits) {
                Ok(size_px) => size_px,
                Err(error) => {
                    tracing::warn!(path = %path.display(), %error, "unreadable picture skipped");
                    self.unreadable += 1;
                    continue;
                }
            };
            if width.min(height) < least_side_px {
                small += 1;
                continue;
            }
            let fold = fold.unwrap_or_else(|| drawn_fold(path, folder));
            let index = self.entries.len();
            match fold {
                Fold::Training => self
                    .training
                    .extend(std::iter::repeat_n(index, folder.repeat)),
                Fold::Validation => self.validation.push(index),
            }
            let class = class.as_ref().and_then(|class| numbers.get(class));
            self.entries.push(Entry {
                path: path.clone(),
                fold,
                side_px: width.min(height),
                scene: class.map(|class| Scene {
                    class: *class,
                    among: among.clone(),
                }),
                labels: None,
            });
        }
        if small > 0 {
            tracing::warn!(
                "{}: {small} pictures are skipped: their shorter side is below {least_side_px} px, three quarters of `pairs.side_px`",
                folder.path.display()
            );
            self.unreadable += small;
        }
        Ok(())
    }

    /// Attaches the keypoint labels of a cache to the training pictures.
    ///
    /// # Errors
    /// [`TrainError::Labels`] if some have no labels yet.
    pub fn with_labels(mut self, cache: &LabelCache) -> Result<Self, TrainError> {
        let training = self.entries.par_iter_mut();
        let training = training.filter(|entry| entry.fold == Fold::Training);
        let missing: usize = training
            .map(|entry| {
                let file = cache.file_of(&entry.path)?;
                let missing = usize::from(!file.exists());
                entry.labels = Some(file);
                Ok(missing)
            })
            .sum::<Result<usize, TrainError>>()?;
        if missing > 0 {
            return Err(cache.incomplete(missing, self.training_count()));
        }
        Ok(self)
    }

    /// Numbers the pictures from `first` on as [`super::Place::picture`], so that several sets can be told apart.
    #[must_use]
    pub fn with_first_place(self, first: usize) -> Self {
        Self {
            first_place: first,
            ..self
        }
    }

    /// Number of all pictures.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are no pictures.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The number of a picture among those of all sets.
    pub(super) fn place_of(&self, index: usize) -> usize {
        self.first_place + index
    }

    /// Indices of the training pictures, each once.
    pub fn training_indices(&self) -> Vec<usize> {
        let training = |index: &usize| self.entries[*index].fold == Fold::Training;
        (0..self.entries.len()).filter(training).collect()
    }

    /// Number of training pictures, each counted once.
    pub fn training_count(&self) -> usize {
        self.training_indices().len()
    }

    /// Indices of a fold, each repeated by its weight.
    pub fn fold(&self, fold: Fold) -> &[usize] {
        match fold {
            Fold::Training => &self.training,
            Fold::Validation => &self.validation,
        }
    }

    /// Number of skipped files.
    pub fn unreadable(&self) -> usize {
        self.unreadable
    }

    /// Number of scene classes of all folders together.
    pub fn scenes(&self) -> usize {
        self.scenes
    }

    /// The scene class of a picture; `None` if its folder has no classes.
    pub fn scene(&self, index: usize) -> Option<Scene> {
        self.entries[index].scene.clone()
    }

    /// Length of a picture's shorter side.
    pub fn side_px(&self, index: usize) -> u32 {
        self.entries[index].side_px
    }

    /// File of a picture.
    pub fn path(&self, index: usize) -> &Path {
        &self.entries[index].path
    }

    /// Decodes a picture, or takes it from the cache; `None` if it cannot be decoded.
    pub fn load(&self, index: usize) -> Option<Arc<Picture>> {
        if let Some(picture) = self
            .cache
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .0
            .get(&index)
        {
            return Some(picture.clone());
        }
        let mut picture = self.decode(index)?;
        if let Some(labels) = &self.entries[index].labels {
            match Labels::open(labels) {
                Ok(labels) => picture = picture.with_keypoints(labels.into_points()),
                Err(error) => {
                    tracing::warn!(%error, "labels of a picture cannot be read; the picture is skipped");
                    return None;
                }
            }
        }
        let picture = Arc::new(picture);
        let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if cache.1 + picture.bytes() <= CACHE_BYTES {
            cache.1 += picture.bytes();
            cache.0.insert(index, picture.clone());
        }
        Some(picture)
    }

    /// Decodes a picture; `None` if it cannot be decoded.
    pub fn decode(&self, index: usize) -> Option<Picture> {
        picture_file::open(&self.entries[index].path, self.limits)
    }
}
