//! Making keypoint labels for all pictures of a configuration, by homographic adaptation.

use crate::TrainError;
use crate::config::TrainConfig;
use crate::data::{Detect, LabelCache, LabelOptions, Labels, Pictures, adapt};
use crate::detector::Detector;
use burn::tensor::Device;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::PathBuf;
use std::time::Instant;

/// Pictures after which it is judged whether the detector sees enough.
const JUDGED_AFTER: usize = 32;
/// Fewer keypoints than one for so many pixels are too few: nearly all cells would be labelled "none", and a keypoint head
/// that learns from these sees nothing.
const MOST_PIXELS_PER_KEYPOINT: usize = 64 * 64;

/// How far labelling has come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LabelProgress {
    /// Pictures that have labels, those of earlier runs among them.
    pub labelled: usize,
    /// Pictures altogether, each once.
    pub pictures: usize,
    /// Keypoints found in this run, in the whole pictures (not in their halvings).
    pub keypoints: usize,
    /// Pictures of this run.
    pub of_this_run: usize,
    /// Their pixels.
    pub pixels: usize,
    /// Seconds left, as fast as it went so far.
    pub remaining_s: f64,
}

impl LabelProgress {
    /// Keypoints of a picture of this run, on average.
    pub fn keypoints_per_picture(&self) -> f64 {
        self.keypoints as f64 / self.of_this_run.max(1) as f64
    }

    fn is_sparse(&self) -> bool {
        let judged = self.of_this_run >= JUDGED_AFTER || self.labelled == self.pictures;
        judged && self.keypoints < self.pixels / MOST_PIXELS_PER_KEYPOINT
    }
}

/// The `[labels]` of a configuration.
///
/// # Errors
/// [`TrainError::Config`] where there are none.
fn options_of(config: &TrainConfig) -> Result<&LabelOptions, TrainError> {
    config.labels.as_ref().ok_or_else(|| TrainError::Config {
        reason:
            "there is no `[labels]` table, which says what finds labels and where they are kept"
                .into(),
    })
}

/// Labels the pictures that a configuration trains on and that have no labels by its detector and settings yet. Each
/// picture's file is written when it is done, so that a killed run goes on with the next picture. Ends early where `go_on`
/// says no.
///
/// # Errors
/// No `[labels]`, no pictures, a detector that cannot be opened or sees next to nothing, a folder that cannot be written to.
pub fn label_pictures(
    config: &TrainConfig,
    device: &Device,
    go_on: &mut dyn FnMut(&LabelProgress) -> bool,
) -> Result<LabelProgress, TrainError> {
    let options = options_of(config)?;
    let detector = Detector::open(options.detector.as_deref(), device)?;
    let cache = LabelCache::new(options, detector.hash())?;
    let pictures = Pictures::scan(&config.data, config.least_picture_px())?;
    let (todo, mut progress) = unlabelled(&pictures, &cache)?;
    let started = Instant::now();
    for some in todo.chunks(rayon::current_num_threads()) {
        let found = some
            .par_iter()
            .map(|(index, file)| label(&pictures, *index, file, options, &detector))
            .collect::<Result<Vec<_>, TrainError>>()?;
        progress.labelled += some.len();
        progress.of_this_run += some.len();
        for (keypoints, pixels) in found {
            progress.keypoints += keypoints;
            progress.pixels += pixels;
        }
        if progress.is_sparse() {
            return Err(too_few(&progress, options));
        }
        let left = (progress.pictures - progress.labelled) as f64;
        progress.remaining_s = started.elapsed().as_secs_f64() / progress.of_this_run as f64 * left;
        if !go_on(&progress) {
            break;
        }
    }
    Ok(progress)
}

/// The pictures without labels, each with the file it is to have; pictures with the same bytes once.
fn unlabelled(
    pictures: &Pictures,
    cache: &LabelCache,
) -> Result<(Vec<(usize, PathBuf)>, LabelProgress), TrainError> {
    let files: HashMap<PathBuf, usize> = pictures
        .training_indices()
        .into_par_iter()
        .map(|index| Ok((cache.file_of(pictures.path(index))?, index)))
        .collect::<Result<_, TrainError>>()?;
    let all = files.len();
    let mut todo: Vec<(usize, PathBuf)> = files
        .into_iter()
        .filter(|(file, _)| !file.exists())
        .map(|(file, index)| (index, file))
        .collect();
    todo.sort();
    let progress = LabelProgress {
        labelled: all - todo.len(),
        pictures: all,
        ..LabelProgress::default()
    };
    Ok((todo, progress))
}

/// Says that the labels would teach nothing, and what to do.
fn too_few(progress: &LabelProgress, options: &LabelOptions) -> TrainError {
    let detector = options.detector.as_ref();
    TrainError::Labels {
        reason: format!(
            "{} sees {:.1} keypoints in a picture, of {} pictures, too few to learn from; train it for longer, or lower \
             `threshold` of `[labels]`, now {}",
            detector.map_or("the bundled model".into(), |path| path
                .display()
                .to_string()),
            progress.keypoints_per_picture(),
            progress.of_this_run,
            options.threshold,
        ),
    }
}

/// Labels one picture and tells how many keypoints and pixels it has; one that cannot be decoded has none.
fn label(
    pictures: &Pictures,
    index: usize,
    file: &std::path::Path,
    options: &LabelOptions,
    detector: &dyn Detect,
) -> Result<(usize, usize), TrainError> {
    let (labels, pixels) = match pictures.decode(index) {
        Some(picture) => {
            let (width, height) = picture.size_px();
            let labels = adapt(&picture, options, detector)?;
            (labels, width as usize * height as usize)
        }
        None => (Labels::default(), 0),
    };
    labels.save(file)?;
    Ok((labels.levels.first().map_or(0, Vec::len), pixels))
}
