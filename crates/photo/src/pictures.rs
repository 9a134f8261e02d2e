//! The picture files of a folder.

use std::path::{Path, PathBuf};

/// File extensions of pictures, lower case.
pub const EXTENSIONS: [&str; 6] = ["jpg", "jpeg", "png", "tif", "tiff", "webp"];

/// Returns the picture files directly in `folder`, sorted by path.
///
/// # Errors
/// The folder cannot be read.
pub fn picture_files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut paths: Vec<PathBuf> = fs_err::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    paths.retain(|path| is_picture(path) && may_be_file(path));
    paths.sort();
    Ok(paths)
}

/// Whether a path is a file, or cannot be looked at, such as a link that leads nowhere: whoever opens it says so.
#[must_use]
pub fn may_be_file(path: &Path) -> bool {
    std::fs::metadata(path).map_or(true, |metadata| metadata.is_file())
}

/// Returns the picture files in `folder` and in all folders below it, sorted by path.
///
/// # Errors
/// A folder cannot be read.
pub fn picture_files_below(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut found = picture_files(folder)?;
    for entry in fs_err::read_dir(folder)? {
        let entry = entry?;
        // Links are not followed: they may lead back.
        if entry.file_type()?.is_dir() {
            found.extend(picture_files_below(&entry.path())?);
        }
    }
    found.sort();
    Ok(found)
}

/// Whether a file is a picture by its name: by its extension, unless it is hidden. macOS writes a hidden `._a.jpg` beside each `a.jpg`
/// on the memory cards of drones.
#[must_use]
pub fn is_picture(path: &Path) -> bool {
    let extension = path
        .extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .filter(|_| !is_hidden(path));
    extension.is_some_and(|extension| EXTENSIONS.contains(&extension.as_str()))
}

/// Whether a path's name begins with a dot.
#[must_use]
pub fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

/// File name of a path as text; the whole path if it has none.
#[must_use]
pub fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(
        || path.display().to_string(),
        |name| name.to_string_lossy().into_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_found_by_extension_and_sorted() {
        let folder = tempfile::tempdir().unwrap();
        fs_err::create_dir_all(folder.path().join("sub/x.jpg")).unwrap();
        for name in ["b.JPG", "a.png", "notes.txt", "sub/c.tif", "._a.png"] {
            fs_err::write(folder.path().join(name), "x").unwrap();
        }
        let names = |paths: Vec<PathBuf>| paths.iter().map(|p| file_name(p)).collect::<Vec<_>>();
        let direct = picture_files(folder.path()).unwrap();
        assert_eq!(names(direct), ["a.png", "b.JPG"]);
        let below = picture_files_below(folder.path()).unwrap();
        assert_eq!(names(below), ["a.png", "b.JPG", "c.tif"]);
        assert!(picture_files(&folder.path().join("gone")).is_err());
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("nowhere", folder.path().join("c.jpg")).unwrap();
            let direct = picture_files(folder.path()).unwrap();
            assert_eq!(names(direct), ["a.png", "b.JPG", "c.jpg"], "to be reported");
        }
    }
}
