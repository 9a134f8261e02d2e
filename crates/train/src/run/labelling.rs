//! Keypoint labels for all pictures of a configuration, by homographic adaptation.

use crate::config::TrainConfig;
use crate::data::{Detect, Folder, LabelCache, LabelOptions, Labels, Pictures, Serves, adapt};
use crate::error::TrainError;
use crate::run::detector::Detector;
use burn::tensor::Device;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::PathBuf;
use std::time::Instant;

/// Number of pictures after which the keypoint density is checked.
const JUDGED_AFTER: usize = 32;
/// With less than one keypoint for this many pixels nearly all cells would be labelled "no keypoint", and a keypoint head
/// trained on them would detect nothing.
const MOST_PIXELS_PER_KEYPOINT: usize = 64 * 64;

/// Progress of labelling.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LabelProgress {
    /// Pictures that have labels, including those of earlier runs.
    pub labelled: usize,
    /// Number of pictures, each counted once.
    pub pictures: usize,
    /// Keypoints found in this run at full resolution.
    pub keypoints: usize,
    /// Pictures labelled in this run.
    pub of_this_run: usize,
    /// Number of their pixels.
    pub pixels: usize,
    /// Estimated remaining time, seconds.
    pub remaining_s: f64,
}

impl LabelProgress {
    /// Mean number of keypoints in the pictures of this run.
    pub fn keypoints_per_picture(&self) -> f64 {
        self.keypoints as f64 / self.of_this_run.max(1) as f64
    }

    /// Whether there are too few keypoints. The last few pictures of an interrupted run alone say nothing of the detector.
    fn is_sparse(&self) -> bool {
        let judged = self.of_this_run >= JUDGED_AFTER || self.of_this_run == self.pictures;
        judged && self.keypoints < self.pixels / MOST_PIXELS_PER_KEYPOINT
    }
}

/// The `[labels]` table of a configuration.
///
/// # Errors
/// [`TrainError::Config`] if there is none.
fn options_of(config: &TrainConfig) -> Result<&LabelOptions, TrainError> {
    config.labels.as_ref().ok_or_else(|| TrainError::Config {
        reason:
            "the table `[labels]` is missing; it names the detector and the folder of the labels"
                .into(),
    })
}

/// Labels the training pictures that have no labels by the configured detector and settings yet. Each file is written when its
/// picture is done, so that an interrupted run can be continued; those of a run that finds too few keypoints are removed, for a
/// training run would take them. Ends early if `on_progress` returns `false`.
///
/// # Errors
/// Returns an error if there is no `[labels]` table, there are no pictures, the detector cannot be opened or finds too few
/// keypoints, or the folder cannot be written.
pub fn label_pictures(
    config: &TrainConfig,
    device: &Device,
    on_progress: &mut dyn FnMut(&LabelProgress) -> bool,
) -> Result<LabelProgress, TrainError> {
    let options = options_of(config)?;
    let detector = Detector::open(options.detector.as_deref(), device)?;
    let cache = LabelCache::new(options, detector.hash())?;
    let folders: Vec<Folder> = config
        .data
        .iter()
        .filter(|folder| folder.serves != Serves::Retrieval)
        .cloned()
        .collect();
    if folders.is_empty() {
        return Err(TrainError::Config {
            reason: "no `[[data]]` folder needs labels: the pairs come from procedural worlds, or all folders serve retrieval; train without labels".into(),
        });
    }
    let pictures = Pictures::scan(&folders, config.least_picture_px(), config.photo_limits)?;
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
            for (_, file) in &todo[..progress.of_this_run] {
                fs_err::remove_file(file)?;
            }
            return Err(too_few(&progress, options));
        }
        let left = (progress.pictures - progress.labelled) as f64;
        progress.remaining_s = started.elapsed().as_secs_f64() / progress.of_this_run as f64 * left;
        if !on_progress(&progress) {
            break;
        }
    }
    Ok(progress)
}

/// The pictures without labels, each with the file of its labels; pictures with the same bytes once.
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

/// The error for too few keypoints.
fn too_few(progress: &LabelProgress, options: &LabelOptions) -> TrainError {
    let detector = options.detector.as_ref();
    TrainError::Labels {
        reason: format!(
            "{} finds {:.1} keypoints per picture in {} pictures, which is too few; train the detector longer, or set \
             `labels.threshold` below {}",
            detector.map_or("the bundled model".into(), |path| path
                .display()
                .to_string()),
            progress.keypoints_per_picture(),
            progress.of_this_run,
            options.threshold,
        ),
    }
}

/// Labels one picture. Returns the numbers of keypoints and pixels; both are 0 if the picture cannot be decoded.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rest_of_an_interrupted_run_is_not_judged_alone() {
        let of_this_run = |of_this_run: usize, pictures: usize| LabelProgress {
            labelled: pictures,
            pictures,
            of_this_run,
            pixels: of_this_run * 400 * 400,
            ..LabelProgress::default()
        };
        assert!(!of_this_run(3, 500).is_sparse());
        assert!(of_this_run(3, 3).is_sparse());
        assert!(of_this_run(JUDGED_AFTER, 500).is_sparse());
    }
}
