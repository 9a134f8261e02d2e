//! Finds the photos of Manchester Surface Drone Imagery (MSDI, doi:10.5281/zenodo.6977602) in its published layout.
//!
//! Written from the readme and the code of github.com/scymz2/MSDI_TOOL, and tested on folders of that layout only. The photos to
//! localise are in `calibrated_images`, in the data set's folder or in its `data`, one folder per scene; the true position of the
//! receiver is in their EXIF. Raw pictures, forward views and checkerboards are not used.
//!
//! The data set has no map. Its tool downloads a small one for each photo, centred on that photo's own position
//! (`google_advance_static_images`, `bing_advance_static_images`), which gives the answer away: use a map that covers the flight.

use std::path::{Path, PathBuf};

/// Name of the folder with the photos to localise.
const PHOTOS: &str = "calibrated_images";

/// Returns the folders of photos, one per scene, of the data set in `folder`, or `folder` itself if it is one scene; `None` if it
/// is neither.
#[must_use]
pub fn scenes(folder: &Path) -> Option<Vec<PathBuf>> {
    // The working folder is named by its whole path alone.
    let whole = fs_err::canonicalize(folder).ok()?;
    let is_scene = |path: &Path| path.parent().is_some_and(|above| above.ends_with(PHOTOS));
    if is_scene(folder) || is_scene(&whole) {
        return Some(vec![folder.to_owned()]);
    }
    let holds_scenes = folder.ends_with(PHOTOS) || whole.ends_with(PHOTOS);
    let photos = [PHOTOS.into(), Path::new("data").join(PHOTOS)]
        .iter()
        .map(|inside: &PathBuf| folder.join(inside))
        .chain(holds_scenes.then(|| folder.to_owned()))
        .find(|path| path.is_dir())?;
    let entries = fs_err::read_dir(photos).ok()?;
    let mut scenes: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_dir())
        .collect();
    scenes.sort();
    (!scenes.is_empty()).then_some(scenes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_found_from_the_data_set_down() {
        let root = tempfile::tempdir().unwrap();
        let photos = root.path().join("data").join(PHOTOS);
        for inside in ["data/raw_images/museum", "data/checkboard_images"] {
            fs_err::create_dir_all(root.path().join(inside)).unwrap();
        }
        assert_eq!(scenes(root.path()), None);
        let all: Vec<PathBuf> = ["business_school", "museum"]
            .iter()
            .map(|scene| photos.join(scene))
            .collect();
        for scene in &all {
            fs_err::create_dir_all(scene).unwrap();
        }
        for folder in [root.path(), &root.path().join("data"), &photos] {
            assert_eq!(scenes(folder), Some(all.clone()), "{}", folder.display());
        }
        assert_eq!(scenes(&all[1]), Some(vec![all[1].clone()]));
        // As from within: `.` and `..` have no name.
        let unnamed = all[1].join("..");
        assert_eq!(scenes(&unnamed).map(|found| found.len()), Some(2));
        let unnamed = photos.join("museum/../museum/.");
        assert_eq!(scenes(&unnamed), Some(vec![unnamed.clone()]));
        assert_eq!(scenes(&root.path().join("data/raw_images/museum")), None);
    }
}
