//! Which files of a data set are pictures to train on, for the layouts that publishers give.

use super::pictures::{Fold, Folder};
use crate::TrainError;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How a data set's files are laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// Any pictures, read recursively.
    #[default]
    Pictures,
    /// One folder of pictures a scene class, named after it.
    Classes,
    /// VTRN, the UAV data of the ICRA 2022 General Place Recognition Competition (a part of ALTO), after its readme:
    /// `Train` and `Val`, each with `query_images` and `reference_images/offset_0_None`. `Val` is kept aside whole.
    Vtrn,
    /// RSSDIVCS (Li et al. 2021), which is laid out as [`Layout::Classes`].
    Rssdivcs,
    /// Manchester Surface Drone Imagery (doi:10.5281/zenodo.6977602), after its tool's readme: `calibrated_images`, in the
    /// folder itself or under `data`, and, where they were fetched, the stitched maps beside it. The checkerboards, the raw
    /// pictures and the maps with watermarks are left out.
    Msdi,
}

/// A picture file, the fold that the publisher put it in, and the scene class.
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
                return Err(wrong(folder, "a folder for each scene class"));
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

/// The first of some folders that exists.
fn needed(folder: &Folder, choices: &[&str]) -> Result<PathBuf, TrainError> {
    choices
        .iter()
        .map(|choice| folder.path.join(choice))
        .find(|path| path.is_dir())
        .ok_or_else(|| wrong(folder, &format!("the folder {}", choices.join(" or "))))
}

fn wrong(folder: &Folder, missing: &str) -> TrainError {
    TrainError::Layout {
        path: folder.path.clone(),
        layout: folder.layout,
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
        } else if path.extension().and_then(|e| e.to_str()).is_some_and(|e| {
            ["jpg", "jpeg", "png", "tif", "tiff", "webp"].contains(&e.to_ascii_lowercase().as_str())
        }) {
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
