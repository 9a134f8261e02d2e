//! Folders of pictures, read recursively, and their resolution pyramids.

use super::label_cache::LabelCache;
use super::labels::Labels;
use super::layout::{Layout, Listed, files_of};
use super::scene::Scene;
use crate::TrainError;
use image::RgbImage;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A folder to train on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Folder {
    /// Where it is.
    pub path: PathBuf,
    /// How its files are laid out.
    #[serde(default)]
    pub layout: Layout,
    /// How often each of its pictures counts: few large maps against thousands of small pictures.
    #[serde(default = "one")]
    pub repeat: usize,
}

fn one() -> usize {
    1
}

/// Which pictures of a set: one in twenty, chosen by its path, is kept aside for validation where the
/// publisher made no choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fold {
    /// To train on.
    Training,
    /// Kept aside.
    Validation,
}

/// One picture in that many is kept aside.
const VALIDATION_ONE_IN: u64 = 20;
/// Decoded pictures are kept up to this many bytes; beyond it they are decoded each time.
const CACHE_BYTES: usize = 1_200_000_000;

/// A picture with its halvings.
#[derive(Debug)]
pub struct Picture {
    levels: Vec<RgbImage>,
    /// Known keypoints by level; of further levels those of the last one.
    keypoints: Vec<Vec<[f32; 2]>>,
}

impl Picture {
    /// Builds the pyramid, down to sides of 64 pixels.
    pub fn new(image: RgbImage) -> Self {
        let mut levels = vec![image];
        while let Some(last) = levels.last() {
            if last.width().min(last.height()) < 128 {
                break;
            }
            let half = halved(last);
            levels.push(half);
        }
        Self {
            levels,
            keypoints: Vec::new(),
        }
    }

    /// The same with known keypoints, the strongest first, in pixels of the picture (pixel centres at integers): those of
    /// each level, or one list for all.
    #[must_use]
    pub fn with_keypoints(self, keypoints: Vec<Vec<[f32; 2]>>) -> Self {
        Self { keypoints, ..self }
    }

    /// The keypoints that are known at a level, or at the smallest of which any are; `None` where none are known at all.
    pub fn keypoints(&self, level: usize) -> Option<&[[f32; 2]]> {
        let last = self.keypoints.len().checked_sub(1)?;
        self.keypoints.get(level.min(last)).map(Vec::as_slice)
    }

    /// Number of levels, the picture itself among them.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// The picture at 1 / 2^`level`, or the smallest there is.
    pub fn level(&self, level: usize) -> (&RgbImage, usize) {
        let level = level.min(self.levels.len() - 1);
        (&self.levels[level], level)
    }

    /// Width and height in pixels.
    pub fn size_px(&self) -> (u32, u32) {
        self.levels[0].dimensions()
    }

    fn bytes(&self) -> usize {
        let labels: usize = self.keypoints.iter().map(|points| 8 * points.len()).sum();
        labels
            + self
                .levels
                .iter()
                .map(|level| level.as_raw().len())
                .sum::<usize>()
    }
}

/// Mean of 2 x 2 pixels.
fn halved(image: &RgbImage) -> RgbImage {
    let (width, height) = (image.width() / 2, image.height() / 2);
    let (raw, row) = (image.as_raw(), image.width() as usize * 3);
    let mut out = Vec::with_capacity((width * height * 3) as usize);
    for y in 0..height as usize {
        for x in 0..width as usize {
            for c in 0..3 {
                let at = 2 * y * row + 6 * x + c;
                let sum = u16::from(raw[at])
                    + u16::from(raw[at + 3])
                    + u16::from(raw[at + row])
                    + u16::from(raw[at + row + 3]);
                out.push(((sum + 2) / 4) as u8);
            }
        }
    }
    RgbImage::from_raw(width, height, out).unwrap_or_default()
}

struct Entry {
    path: PathBuf,
    fold: Fold,
    /// The short side.
    side_px: u32,
    scene: Option<Scene>,
    /// Where its keypoint labels are kept, where it has some.
    labels: Option<PathBuf>,
}

/// A set of pictures to draw from.
#[derive(Default)]
pub struct Pictures {
    entries: Vec<Entry>,
    /// Indices into the entries, as often as each counts.
    training: Vec<usize>,
    validation: Vec<usize>,
    unreadable: usize,
    scenes: usize,
    cache: Mutex<(HashMap<usize, Arc<Picture>>, usize)>,
}

/// The pictures of a set that are kept aside.
pub struct Aside(pub Arc<Pictures>);

/// FNV-1a, which says the same on every machine.
fn hash_of(path: &str) -> u64 {
    path.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The fold of a picture whose publisher made no choice: its path below the folder decides, so that moving the folder moves
/// nothing between the folds.
fn drawn_fold(path: &Path, folder: &Folder) -> Fold {
    let inside = path.strip_prefix(&folder.path).unwrap_or(path);
    if hash_of(&inside.to_string_lossy()).is_multiple_of(VALIDATION_ONE_IN) {
        Fold::Validation
    } else {
        Fold::Training
    }
}

impl Pictures {
    /// Lists the pictures of the folders; those whose header cannot be read, or whose short side is below `least_side_px`,
    /// are counted and left out.
    ///
    /// # Errors
    /// [`TrainError::Io`] for a folder that cannot be read, [`TrainError::TooFewPictures`] where fewer than eight are left.
    pub fn scan(folders: &[Folder], least_side_px: u32) -> Result<Self, TrainError> {
        let mut out = Self::default();
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
        for Listed { path, fold, class } in &files {
            let Ok((width, height)) = image::image_dimensions(path) else {
                tracing::warn!(path = %path.display(), "unreadable picture left out");
                self.unreadable += 1;
                continue;
            };
            if width.min(height) < least_side_px {
                self.unreadable += 1;
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
        Ok(())
    }

    /// The same, where the pictures to train on have the keypoint labels of a cache.
    ///
    /// # Errors
    /// [`TrainError::Labels`] where some have none yet.
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

    /// Indices of the pictures to train on, each once.
    pub fn training_indices(&self) -> Vec<usize> {
        let training = |index: &usize| self.entries[*index].fold == Fold::Training;
        (0..self.entries.len()).filter(training).collect()
    }

    /// Pictures to train on, each counted once.
    pub fn training_count(&self) -> usize {
        self.training_indices().len()
    }

    /// Indices of a fold, repeated as often as each picture counts.
    pub fn fold(&self, fold: Fold) -> &[usize] {
        match fold {
            Fold::Training => &self.training,
            Fold::Validation => &self.validation,
        }
    }

    /// Files that were left out.
    pub fn unreadable(&self) -> usize {
        self.unreadable
    }

    /// Number of scene classes, those of all folders together.
    pub fn scenes(&self) -> usize {
        self.scenes
    }

    /// The scene class of a picture, where its folder has classes.
    pub fn scene(&self, index: usize) -> Option<Scene> {
        self.entries[index].scene.clone()
    }

    /// The short side of a picture.
    pub fn side_px(&self, index: usize) -> u32 {
        self.entries[index].side_px
    }

    /// Where a picture comes from.
    pub fn path(&self, index: usize) -> &Path {
        &self.entries[index].path
    }

    /// Decodes a picture, or takes it from the cache; `None` where it cannot be decoded.
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
                    tracing::warn!(%error, "picture without its labels; another is taken");
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

    /// Decodes a picture; `None` where it cannot be decoded.
    pub fn decode(&self, index: usize) -> Option<Picture> {
        let path = &self.entries[index].path;
        match image::ImageReader::open(path).map(image::ImageReader::decode) {
            Ok(Ok(image)) => Some(Picture::new(image.into_rgb8())),
            _ => {
                tracing::warn!(path = %path.display(), "picture cannot be decoded; another is taken");
                None
            }
        }
    }
}
