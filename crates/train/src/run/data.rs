//! The data of a run: what it trains on and what it holds out.

use crate::config::{Stage, TrainConfig};
use crate::data::{
    CrossView, Fold, Folder, HeldOut, LabelCache, Layout, Pictures, Serves, Shapes, Source,
    Sources, Task, WeightedSource, Worlds,
};
use crate::error::TrainError;
use crate::run::detector::Detector;
use burn::tensor::Device;
use std::sync::Arc;

/// Fewest matches of a VTRN folder to train on.
const LEAST_MATCHES: usize = 8;

/// The data of a run.
#[derive(Clone)]
pub struct Data {
    /// Sources of training pairs.
    pub training: Sources,
    /// Sources of validation pairs, by name: pictures and worlds that training never sees.
    pub held_out: Vec<(&'static str, Arc<dyn Source>)>,
    /// Number of training pictures.
    pub pictures: usize,
    /// Number of picture files that cannot be used.
    pub unreadable: usize,
    /// Number of pictures listed, held-out ones included.
    entries: usize,
}

impl Data {
    /// Lists the pictures of a configuration and plans its worlds.
    ///
    /// # Errors
    /// Returns an error if a folder cannot be read, does not have its layout, has too few usable pictures, or lies in another.
    pub fn open(config: &TrainConfig) -> Result<Self, TrainError> {
        let mut out = Self {
            training: Vec::new(),
            held_out: Vec::new(),
            pictures: 0,
            unreadable: 0,
            entries: 0,
        };
        if config.stage == Stage::Shapes {
            out.training
                .push(WeightedSource::new(1.0, Arc::new(Shapes)));
            out.held_out.push(("shapes", Arc::new(Shapes)));
            return Ok(out);
        }
        check_apart(config)?;
        let mut weighted = Vec::new();
        for serves in [Serves::Both, Serves::Retrieval, Serves::Matching] {
            out.add_pictures(config, serves, &mut weighted)?;
        }
        out.add_cross_views(config, &mut weighted)?;
        let total: usize = weighted.iter().map(|(weight, ..)| weight).sum();
        let share_of = |weight: usize| weight as f64 / total.max(1) as f64;
        let of_worlds = shares_of_worlds(&weighted, share_of);
        for (weight, serves, source) in weighted {
            out.training.push(WeightedSource {
                share: (1.0 - config.world_share) * share_of(weight),
                serves,
                source,
            });
        }
        if config.world_share > 0.0 {
            let worlds = |fold| Arc::new(Worlds::new(&config.world, fold, config.seed));
            let training = worlds(Fold::Training);
            for (serves, share) in of_worlds {
                out.training.push(WeightedSource {
                    share: config.world_share * share,
                    serves,
                    source: training.clone(),
                });
            }
            out.held_out
                .push(("procedural worlds", worlds(Fold::Validation)));
        }
        tracing::info!(
            pictures = out.pictures,
            unreadable = out.unreadable,
            "training data"
        );
        Ok(out)
    }

    /// Adds the single pictures of the folders that serve `serves`, weighted by their number.
    fn add_pictures(
        &mut self,
        config: &TrainConfig,
        serves: Serves,
        weighted: &mut Vec<(usize, Serves, Arc<dyn Source>)>,
    ) -> Result<(), TrainError> {
        let is_of_task = |folder: &&Folder| tasks_of(config, folder) == serves;
        let folders: Vec<Folder> = config
            .data
            .iter()
            .filter(is_of_task)
            .filter(|folder| !is_cross_view(config, folder))
            .cloned()
            .collect();
        if folders.is_empty() {
            return Ok(());
        }
        let first_place = self.entries;
        let mut pictures =
            Pictures::scan(&folders, config.least_picture_px(), config.photo_limits)?
                .with_first_place(first_place);
        let labels = config
            .labels
            .as_ref()
            .filter(|_| config.stage == Stage::Joint && serves != Serves::Retrieval);
        if let Some(options) = labels {
            let detector = Detector::open(options.detector.as_deref(), &Device::flex())?;
            pictures = pictures.with_labels(&LabelCache::new(options, detector.hash())?)?;
        }
        let pictures = Arc::new(pictures);
        self.entries += pictures.len();
        self.pictures += pictures.training_count();
        self.unreadable += pictures.unreadable();
        if !pictures.fold(Fold::Validation).is_empty() {
            self.held_out
                .push((held_out_name(serves), Arc::new(HeldOut(pictures.clone()))));
        }
        let weight = pictures.fold(Fold::Training).len();
        weighted.push((weight, serves, pictures));
        Ok(())
    }

    /// Adds the matched pictures of VTRN folders that serve retrieval.
    fn add_cross_views(
        &mut self,
        config: &TrainConfig,
        weighted: &mut Vec<(usize, Serves, Arc<dyn Source>)>,
    ) -> Result<(), TrainError> {
        for (index, folder) in config.data.iter().enumerate() {
            if !is_cross_view(config, folder) {
                continue;
            }
            let training = CrossView::open(folder, Fold::Training, index, config.photo_limits)?;
            self.unreadable += training.unreadable();
            if training.len() < LEAST_MATCHES {
                return Err(TrainError::TooFewPictures {
                    found: training.len(),
                    unreadable: training.unreadable(),
                    folders: folder.path.display().to_string(),
                    needed: LEAST_MATCHES,
                });
            }
            self.pictures += training.len();
            weighted.push((
                training.len() * folder.repeat,
                Serves::Retrieval,
                Arc::new(training),
            ));
            let held_out = CrossView::open(folder, Fold::Validation, index, config.photo_limits)?;
            if !held_out.is_empty() {
                self.held_out.push(("cross-view pairs", Arc::new(held_out)));
            }
        }
        Ok(())
    }
}

/// Checks that no two folders have pictures in common. Such a picture would be two places, so that its ground would be a negative of
/// itself, and it could be trained on through one folder and held out through the other.
///
/// # Errors
/// [`TrainError::Config`] with the folders.
fn check_apart(config: &TrainConfig) -> Result<(), TrainError> {
    let folders = || config.data.iter().enumerate();
    for (i, folder) in folders() {
        for (_, other) in folders().filter(|(j, _)| *j != i) {
            // A folder that is not there is reported where it is read.
            let (Ok(path), Ok(outer)) = (
                fs_err::canonicalize(&folder.path),
                fs_err::canonicalize(&other.path),
            ) else {
                continue;
            };
            let tasks = [folder, other].map(|folder| tasks_of(config, folder));
            let never_meet = [Task::Retrieval, Task::Matching]
                .into_iter()
                .all(|task| !tasks.iter().all(|serves| serves.includes(Some(task))));
            // One folder may serve the two tasks in two entries: no step has pairs of both, and in one layout the held-out pictures are
            // the same. In another they are not: the publisher's `Val` is held out of `vtrn`, and most of it trained on as `pictures`.
            let is_shared = path == outer && never_meet && folder.layout == other.layout;
            if path.starts_with(&outer) && !is_shared {
                return Err(TrainError::Config {
                    reason: format!(
                        "the `[[data]]` folder {} is or lies in another, {}: pictures must not belong to two entries, unless both have one `layout` and one serves retrieval, the other matching; remove one, or name folders beside each other to give them different weights",
                        folder.path.display(),
                        other.path.display()
                    ),
                });
            }
        }
    }
    Ok(())
}

/// The tasks that worlds train beside these pictures, and the share of all pictures that each of them has: each task by itself where
/// pictures serve one alone, for the share of worlds is that of the steps of each task.
fn shares_of_worlds(
    pictures: &[(usize, Serves, Arc<dyn Source>)],
    share_of: impl Fn(usize) -> f64,
) -> Vec<(Serves, f64)> {
    let all_serve_both = pictures
        .iter()
        .all(|(_, serves, _)| *serves == Serves::Both);
    if all_serve_both {
        return vec![(Serves::Both, 1.0)];
    }
    let with_share = |(serves, task)| {
        let serving = pictures.iter().filter(|(_, s, _)| s.includes(Some(task)));
        let weight = serving.map(|(weight, ..)| weight).sum();
        // Where worlds alone serve a task, any share is all of it.
        let share = if weight == 0 { 1.0 } else { share_of(weight) };
        (serves, share)
    };
    [
        (Serves::Retrieval, Task::Retrieval),
        (Serves::Matching, Task::Matching),
    ]
    .map(with_share)
    .into()
}

/// The tasks that a folder's pairs train; only the joint stage tells them apart.
fn tasks_of(config: &TrainConfig, folder: &Folder) -> Serves {
    match config.stage {
        Stage::Joint => folder.serves,
        Stage::Shapes | Stage::Scenes => Serves::Both,
    }
}

/// Whether a folder gives matched pictures in place of single ones.
fn is_cross_view(config: &TrainConfig, folder: &Folder) -> bool {
    folder.layout == Layout::Vtrn && tasks_of(config, folder) == Serves::Retrieval
}

fn held_out_name(serves: Serves) -> &'static str {
    match serves {
        Serves::Both => "pictures",
        Serves::Retrieval => "retrieval pictures",
        Serves::Matching => "matching pictures",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::PairOptions;
    use image::{Rgb, RgbImage};
    use std::path::Path;

    fn folder(root: &Path, serves: Serves, pictures: u8) -> Folder {
        let path = root.join(format!("{serves:?}"));
        std::fs::create_dir_all(&path).unwrap();
        for i in 0..pictures {
            let picture = RgbImage::from_pixel(64, 64, Rgb([i, 90, 120]));
            picture.save(path.join(format!("{i}.png"))).unwrap();
        }
        Folder {
            path,
            layout: Layout::Pictures,
            repeat: 1,
            serves,
        }
    }

    /// Shares of all sources and of the worlds in the steps of a task.
    fn world_share(data: &Data, task: Option<Task>, worlds: usize) -> f64 {
        let share = |sources: &[WeightedSource]| -> f64 {
            let serving = sources.iter().filter(|one| one.serves.includes(task));
            serving.map(|one| one.share).sum()
        };
        let first = data.training.len() - worlds;
        share(&data.training[first..]) / share(&data.training)
    }

    #[test]
    fn worlds_have_their_share_of_the_steps_of_each_task() {
        let root = tempfile::tempdir().unwrap();
        let config = TrainConfig {
            data: vec![
                folder(root.path(), Serves::Retrieval, 12),
                folder(root.path(), Serves::Matching, 60),
            ],
            world_share: 0.2,
            alternate: true,
            global_from: 0.0,
            pairs: PairOptions {
                side_px: 64,
                points: 12,
                ..PairOptions::default()
            },
            ..TrainConfig::default()
        };
        let data = Data::open(&config).unwrap();
        for task in [Task::Retrieval, Task::Matching] {
            let share = world_share(&data, Some(task), 2);
            assert!((share - 0.2).abs() < 1e-9, "{task:?}: {share}");
        }
        let together = TrainConfig {
            data: vec![folder(root.path(), Serves::Both, 12)],
            ..config
        };
        let share = world_share(&Data::open(&together).unwrap(), None, 1);
        assert!((share - 0.2).abs() < 1e-9, "{share}");
    }
}
