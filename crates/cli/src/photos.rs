//! The photos that a command line names: files, folders and patterns.

use std::collections::{HashMap, HashSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glob::MatchOptions;
use grimnet_photo::pictures::{EXTENSIONS, is_hidden, may_be_file, picture_files};

use crate::own_pictures::is_own;

/// Expands arguments to photos: a file to itself, a folder to the pictures directly in it (sorted), a
/// pattern with `*`, `?` or `[` to the files that it matches (sorted). Drawings of this program in folders and among the matches are left
/// out.
///
/// # Errors
/// A folder or pattern without photos.
pub fn expand(arguments: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut photos = Vec::new();
    for argument in arguments {
        let found = expand_one(argument)?;
        if found.is_empty() {
            bail!(
                "{}: no photos found (looked for {}, not in folders below it; name each folder that holds photos)",
                argument.display(),
                EXTENSIONS.join(", ")
            );
        }
        photos.extend(found);
    }
    Ok(photos)
}

fn expand_one(argument: &Path) -> Result<Vec<PathBuf>> {
    if argument.is_dir() {
        return Ok(without_drawings(picture_files(argument)?));
    }
    let text = argument.to_string_lossy();
    if argument.exists() || !text.contains(['*', '?', '[']) {
        // A missing file is reported in its own answer, so that the other photos are located.
        return Ok(vec![argument.to_owned()]);
    }
    // As in folders: a shell hands on the pattern `*.jpg` where the cameras' names end in `.JPG`.
    let options = MatchOptions {
        case_sensitive: false,
        ..MatchOptions::new()
    };
    // Cameras and copies name files `a [1].jpg`: what matches nothing with brackets alone is such a file that is missing.
    let may_be_name = !text.contains(['*', '?']);
    let matches = match glob::glob_with(&text, options) {
        Err(_) if may_be_name => return Ok(vec![argument.to_owned()]),
        matches => matches.with_context(|| format!("{text}: not a valid pattern"))?,
    };
    // Not by the option of `glob`, which ends the program at a name that is not UTF-8.
    let names_hidden = is_hidden(argument);
    let files = matches
        .filter_map(Result::ok)
        .filter(|path| may_be_file(path) && (names_hidden || !is_hidden(path)));
    let files: Vec<PathBuf> = files.collect();
    if files.is_empty() && may_be_name {
        return Ok(vec![argument.to_owned()]);
    }
    Ok(without_drawings(files))
}

fn without_drawings(mut files: Vec<PathBuf>) -> Vec<PathBuf> {
    files.retain(|path| {
        let is_drawing = is_own(path);
        if is_drawing {
            tracing::info!("{}: a drawing of grim, left out", path.display());
        }
        !is_drawing
    });
    files
}

/// A different name for the drawing of each photo, without ending: the photo's name; if several photos share it, with the name
/// of their folder in front; if that is shared as well, with a number.
pub fn picture_names(photos: &[PathBuf]) -> Vec<String> {
    let text = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let stems: Vec<String> = photos.iter().map(|path| text(path.file_stem())).collect();
    let mut sharing: HashMap<&str, usize> = HashMap::new();
    for stem in &stems {
        *sharing.entry(stem).or_default() += 1;
    }
    let mut taken = HashSet::new();
    let name_of = |(path, stem): (&PathBuf, &String)| {
        let folder = text(path.parent().and_then(Path::file_name));
        let name = if sharing[stem.as_str()] > 1 && !folder.is_empty() {
            format!("{folder}_{stem}")
        } else {
            stem.clone()
        };
        let numbered = (2..).map(|number| format!("{name}-{number}"));
        std::iter::once(name.clone())
            .chain(numbered)
            .find(|name| taken.insert(name.clone()))
            .unwrap_or(name)
    };
    photos.iter().zip(&stems).map(name_of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::own_pictures;

    #[test]
    fn no_picture_takes_anothers_name() {
        let photos = ["a/1.jpg", "b/1.jpg", "b/1.png", "b/2.jpg", "2.jpg"].map(PathBuf::from);
        let names = picture_names(&photos);
        assert_eq!(names, ["a_1", "b_1", "b_1-2", "b_2", "2"]);
    }

    #[test]
    fn folders_files_and_patterns() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.JPG", "a.jpg", "notes.txt", "c.png", "._a.jpg"] {
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
        assert_eq!(names(&[dir.path().join("*.jpg")]), ["a.jpg", "b.JPG"]);
        assert_eq!(names(&[dir.path().join("gone.jpg")]), ["gone.jpg"]);
        for name in ["gone [1].jpg", "gone [.jpg"] {
            assert_eq!(names(&[dir.path().join(name)]), [name]);
        }
        assert_eq!(names(&[dir.path().join("[ab].jpg")]), ["a.jpg", "b.JPG"]);
        assert!(expand(&[dir.path().join("*.webp")]).is_err());
        let [card, below] = ["DCIM", "DCIM/100MEDIA"].map(|name| dir.path().join(name));
        fs_err::create_dir_all(&below).unwrap();
        fs_err::write(below.join("DJI_0001.JPG"), "x").unwrap();
        assert_eq!(names(&[below]), ["DJI_0001.JPG"]);
        let refused = expand(&[card]).unwrap_err().to_string();
        assert!(
            refused.contains("name each folder that holds photos"),
            "{refused}"
        );
        let drawing = own_pictures::encoded(&image::RgbImage::new(8, 8), image::ImageFormat::Png);
        let path = dir.path().join("d.png");
        fs_err::write(&path, drawing.unwrap()).unwrap();
        assert_eq!(names(&[dir.path().to_owned()]), ["a.jpg", "b.JPG", "c.png"]);
        assert_eq!(names(&[dir.path().join("*.png")]), ["c.png"]);
        assert_eq!(names(&[path]), ["d.png"], "it is asked for");
        #[cfg(unix)]
        {
            use std::os::unix::ffi::OsStrExt;
            for name in [&b"caf\xe9.txt"[..], b"caf\xe9.jpg", b"._a.jpg"] {
                fs_err::write(dir.path().join(OsStr::from_bytes(name)), "x").unwrap();
            }
            let found = names(&[dir.path().join("*.jpg")]);
            assert_eq!(found, ["a.jpg", "b.JPG"], "patterns match names of UTF-8");
        }
    }
}
