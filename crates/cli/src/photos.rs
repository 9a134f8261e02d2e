//! Which photos the command line means: files, folders and patterns.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

/// File endings that are taken from a folder, lower case.
const PHOTO_ENDINGS: &[&str] = &["jpg", "jpeg", "png", "tif", "tiff", "webp"];

/// Expands arguments to photos: a file as it stands, a folder to the pictures directly in it (sorted), a
/// pattern with `*`, `?` or `[` to what it matches (sorted).
///
/// # Errors
/// An argument that names nothing.
pub fn expand(arguments: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut photos = Vec::new();
    for argument in arguments {
        let found = expand_one(argument)?;
        if found.is_empty() {
            bail!(
                "{}: no photos there (looked for {})",
                argument.display(),
                PHOTO_ENDINGS.join(", ")
            );
        }
        photos.extend(found);
    }
    Ok(photos)
}

fn expand_one(argument: &Path) -> Result<Vec<PathBuf>> {
    if argument.is_dir() {
        let mut photos = Vec::new();
        for entry in fs_err::read_dir(argument)? {
            let path = entry?.path();
            if path.is_file() && has_photo_ending(&path) {
                photos.push(path);
            }
        }
        photos.sort();
        return Ok(photos);
    }
    let text = argument.to_string_lossy();
    if argument.exists() || !text.contains(['*', '?', '[']) {
        // A file that is not there is answered in its own line, so that the other photos are localised.
        return Ok(vec![argument.to_owned()]);
    }
    let matches = glob::glob(&text).with_context(|| format!("{text}: not a usable pattern"))?;
    Ok(matches
        .filter_map(Result::ok)
        .filter(|p| p.is_file())
        .collect())
}

fn has_photo_ending(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| PHOTO_ENDINGS.contains(&e.to_string_lossy().to_lowercase().as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_files_and_patterns() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.JPG", "a.jpg", "notes.txt", "c.png"] {
            fs_err::write(dir.path().join(name), "x").unwrap();
        }
        let names = |arguments: &[PathBuf]| -> Vec<String> {
            expand(arguments)
                .unwrap()
                .iter()
                .map(|p| p.file_name().unwrap().to_string_lossy().into_owned())
                .collect()
        };
        assert_eq!(names(&[dir.path().to_owned()]), ["a.jpg", "b.JPG", "c.png"]);
        assert_eq!(names(&[dir.path().join("*.jpg")]), ["a.jpg"]);
        assert_eq!(names(&[dir.path().join("gone.jpg")]), ["gone.jpg"]);
        assert!(expand(&[dir.path().join("*.webp")]).is_err());
    }
}
