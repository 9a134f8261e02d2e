//! Folders of training data: which files are pictures, for the layouts that publishers use.

use crate::error::TrainError;
use grimnet_photo::pictures::is_picture;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How a data set's files are laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// Any pictures, read recursively.
    #[default]
    Pictures,
    /// One folder of pictures for each scene class, named after the class.
    Classes,
    /// VTRN, the UAV data of the ICRA 2022 General Place Recognition Competition (a part of ALTO), after its readme:
    /// `Train` and `Val`, each with `query_images`, `reference_images/offset_0_None`, `gt_matches.csv` and
    /// `reference.csv`. `Val` is held out.
    Vtrn,
    /// RSSDIVCS (Li et al. 2021), which is laid out as [`Layout::Classes`].
    Rssdivcs,
    /// Manchester Surface Drone Imagery (doi:10.5281/zenodo.6977602), after its tool's readme: `calibrated_images`, in the
    /// folder itself or under `data`, and the stitched maps beside it if they were downloaded. Checkerboards, raw pictures
    /// and maps with watermarks are skipped.
    Msdi,
}

impl Layout {
    /// The name in a configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pictures => "pictures",
            Self::Classes => "classes",
            Self::Vtrn => "vtrn",
            Self::Rssdivcs => "rssdivcs",
            Self::Msdi => "msdi",
        }
    }
}

/// The tasks that a data set's pairs train.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Serves {
    /// Retrieval and matching.
    #[default]
    Both,
    /// Retrieval (encoder and NetVLAD). With [`Layout::Vtrn`], pairs are an aircraft picture and the map picture that
    /// `gt_matches.csv` names.
    Retrieval,
    /// Matching (encoder, keypoint and descriptor decoders).
    Matching,
}

impl Serves {
    /// Whether its pairs can train a task; every data set serves `None`, which stands for any task.
    pub(crate) fn includes(self, task: Option<Task>) -> bool {
        match (self, task) {
            (Self::Both, _) | (_, None) => true,
            (Self::Retrieval, Some(task)) => task == Task::Retrieval,
            (Self::Matching, Some(task)) => task == Task::Matching,
        }
    }
}

/// The paper's two tasks, trained in turns (section 4.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// Trains encoder and NetVLAD.
    Retrieval,
    /// Trains encoder and decoders.
    Matching,
}

impl Task {
    /// The task of a step, when they are trained in turns.
    pub(crate) fn of_step(step: u64) -> Self {
        if step % 2 == 1 {
            Self::Retrieval
        } else {
            Self::Matching
        }
    }
}

/// A folder of training data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Folder {
    /// The folder.
    pub path: PathBuf,
    /// How its files are laid out.
    #[serde(default)]
    pub layout: Layout,
    /// Weight of each of its pictures in the random choice, so that few large maps can balance thousands of small pictures.
    #[serde(default = "one")]
    pub repeat: usize,
    /// The tasks that its pairs train. Other than `both` needs `alternate`.
    #[serde(default)]
    pub serves: Serves,
}

fn one() -> usize {
    1
}

/// Part of a data set. Where the publisher made no split, one picture in twenty, chosen by its path, is held out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fold {
    /// Trained on.
    Training,
    /// Held out for validation.
    Validation,
}

/// A picture file, its part in the publisher's split, and its scene class.
pub(super) struct Listed {
    pub(super) path: PathBuf,
    pub(super) fold: Option<Fold>,
    pub(super) class: Option<String>,
}

/// The picture files of a folder, sorted.
pub(super) fn files_of(folder: &Folder) -> Result<Vec<Listed>, TrainError> {
    let root = folder.path.as_path();
    match folder.layout {
        Layout::Pictures => listed(root, None),
        Layout::Vtrn => {
            let mut out = Vec::new();
            for (split, fold) in [("Train", Fold::Training), ("Val", Fold::Validation)] {
                for inside in ["query_images", "reference_images/offset_0_None"] {
                    out.extend(listed(
                        &needed(folder, &[&format!("{split}/{inside}")])?,
                        Some(fold),
                    )?);
                }
            }
            Ok(out)
        }
        Layout::Classes | Layout::Rssdivcs => {
            let mut classes = Vec::new();
            for entry in fs_err::read_dir(root)? {
                let path = entry?.path();
                if path.is_dir() {
                    classes.push(path);
                }
            }
            if classes.len() < 2 {
                return Err(layout_error(folder, "a folder for each scene class"));
            }
            classes.sort();
            let mut out = Vec::new();
            for path in classes {
                let class = path
                    .file_name()
                    .map(|name| name.to_string_lossy().into_owned());
                out.extend(listed(&path, None)?.into_iter().map(|file| Listed {
                    class: class.clone(),
                    ..file
                }));
            }
            Ok(out)
        }
        Layout::Msdi => {
            let photos = needed(folder, &["calibrated_images", "data/calibrated_images"])?;
            let mut out = listed(&photos, None)?;
            for maps in ["google_advance_static_images", "bing_advance_static_images"] {
                let path = photos.with_file_name(maps);
                if path.is_dir() {
                    out.extend(listed(&path, None)?);
                }
            }
            Ok(out)
        }
    }
}

/// The first of several alternative folders that exists.
pub(super) fn needed(folder: &Folder, choices: &[&str]) -> Result<PathBuf, TrainError> {
    choices
        .iter()
        .map(|choice| folder.path.join(choice))
        .find(|path| path.is_dir())
        .ok_or_else(|| layout_error(folder, &format!("the folder {}", choices.join(" or "))))
}

pub(super) fn layout_error(folder: &Folder, missing: &str) -> TrainError {
    TrainError::Layout {
        path: folder.path.clone(),
        layout: folder.layout.name(),
        missing: missing.to_owned(),
    }
}

fn listed(root: &Path, fold: Option<Fold>) -> Result<Vec<Listed>, TrainError> {
    let mut files = Vec::new();
    files_under(root, &mut files)?;
    Ok(files
        .into_iter()
        .map(|path| Listed {
            path,
            fold,
            class: None,
        })
        .collect())
}

fn files_under(folder: &Path, out: &mut Vec<PathBuf>) -> Result<(), TrainError> {
    let mut entries: Vec<PathBuf> = fs_err::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<_, std::io::Error>>()?;
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files_under(&path, out)?;
        } else if is_picture(&path) {
            out.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn make(root: &Path, files: &[&str]) {
        for file in files {
            let path = root.join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, b"").unwrap();
        }
    }

    fn names(root: &Path, layout: Layout) -> Result<Vec<(String, Option<Fold>)>, TrainError> {
        let folder = Folder {
            path: root.to_owned(),
            repeat: 1,
            layout,
            serves: Serves::default(),
        };
        let inside = |path: &Path| path.strip_prefix(root).unwrap().display().to_string();
        Ok(files_of(&folder)?
            .iter()
            .map(|file| (inside(&file.path), file.fold))
            .collect())
    }

    #[test]
    fn the_competition_keeps_its_split() {
        let root = tempfile::tempdir().unwrap();
        for split in ["Train", "Val"] {
            for file in [
                "query_images/000000.png",
                "reference_images/offset_0_None/000000.png",
                "reference_images/offset_20_North/000000.png",
                "query.csv",
            ] {
                make(root.path(), &[&format!("{split}/{file}")]);
            }
        }
        let found = names(root.path(), Layout::Vtrn).unwrap();
        assert_eq!(found.len(), 4);
        assert_eq!(
            found[0],
            ("Train/query_images/000000.png".into(), Some(Fold::Training))
        );
        assert_eq!(found[3].1, Some(Fold::Validation));
        let error = names(&root.path().join("Train"), Layout::Vtrn).unwrap_err();
        assert!(error.to_string().contains("Train/query_images"), "{error}");
    }

    #[test]
    fn hidden_files_and_other_files_are_left_out() {
        let root = tempfile::tempdir().unwrap();
        make(
            root.path(),
            &["b/2.JPG", "b/._2.JPG", "._1.png", "1.png", ".jpg", "1.pgw"],
        );
        let found = names(root.path(), Layout::Pictures).unwrap();
        let found: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(found, ["1.png", "b/2.JPG"]);
    }

    #[test]
    fn classes_and_calibrated_photos_are_found_and_the_rest_left_out() {
        let root = tempfile::tempdir().unwrap();
        make(root.path(), &["Airport/1.jpg", "Beach/2.jpg", "readme.txt"]);
        assert_eq!(names(root.path(), Layout::Rssdivcs).unwrap().len(), 2);
        assert!(names(&root.path().join("Beach"), Layout::Rssdivcs).is_err());
        make(
            root.path(),
            &[
                "data/calibrated_images/EC_001.JPG",
                "data/raw_images/EC_001.JPG",
                "data/checkboard_images/1.JPG",
                "data/bing_advance_static_images/EC_001.png",
            ],
        );
        let found = names(root.path(), Layout::Msdi).unwrap();
        let found: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            found,
            [
                "data/calibrated_images/EC_001.JPG",
                "data/bing_advance_static_images/EC_001.png"
            ]
        );
    }
}
