//! Outputs that a run is going to write, compared before it begins.

use std::fs;
use std::path::{Path, PathBuf};

use crate::aside::PARTIAL_ENDING;
use crate::error::{OutputError, Result};
use crate::listing::LISTING_NAME;
use crate::target::{MAX_LINKS, folder_of};

/// An output that a run is going to write, and the option that asks for it.
#[derive(Debug, Clone)]
pub struct PlannedOutput {
    option: String,
    path: PathBuf,
    kind: Kind,
}

#[derive(Debug, Clone)]
enum Kind {
    File,
    StandardOutput,
    /// With the names of the files that are written into it.
    Folder(Vec<String>),
}

impl PlannedOutput {
    /// A file that `option` names.
    #[must_use]
    pub fn file(option: &str, path: impl AsRef<Path>) -> Self {
        Self::new(option, path.as_ref(), Kind::File)
    }

    /// Standard output, as `option` asks for it.
    #[must_use]
    pub fn standard_output(option: &str) -> Self {
        Self::new(option, Path::new("/dev/stdout"), Kind::StandardOutput)
    }

    /// A folder that `option` names, into which files of these names are written.
    #[must_use]
    pub fn folder(
        option: &str,
        path: impl AsRef<Path>,
        names: impl IntoIterator<Item = impl Into<String>>,
    ) -> Self {
        let names = names.into_iter().map(Into::into).collect();
        Self::new(option, path.as_ref(), Kind::Folder(names))
    }

    fn new(option: &str, path: &Path, kind: Kind) -> Self {
        Self {
            option: option.to_owned(),
            path: path.to_owned(),
            kind,
        }
    }
}

/// Checks that no two outputs of a run meet: the same file, the same folder, or a file where the other's folder, one of its
/// files or a working file of it will be. Call it before any of them is opened.
///
/// # Errors
/// [`OutputError::Meet`] for the first two that do.
pub fn check_apart(outputs: &[PlannedOutput]) -> Result<()> {
    let places: Vec<PathBuf> = outputs
        .iter()
        .map(|output| resolved(&output.path))
        .collect();
    let placed = || outputs.iter().zip(places.iter().map(PathBuf::as_path));
    for (number, (second, second_place)) in placed().enumerate() {
        for (first, first_place) in placed().take(number) {
            if meet((&first.kind, first_place), (&second.kind, second_place)) {
                return Err(OutputError::Meet {
                    first: first.option.clone(),
                    second: second.option.clone(),
                    path: second.path.clone(),
                });
            }
        }
    }
    Ok(())
}

fn meet((a, a_place): (&Kind, &Path), (b, b_place): (&Kind, &Path)) -> bool {
    match (a, b) {
        (Kind::StandardOutput, Kind::StandardOutput) => true,
        (Kind::Folder(_), Kind::Folder(_)) => a_place == b_place,
        (Kind::Folder(names), _) => file_meets_folder(b_place, a_place, names),
        (_, Kind::Folder(names)) => file_meets_folder(a_place, b_place, names),
        // A terminal and `/dev/null` take what comes from several writers.
        _ if is_character_device(a_place) => false,
        _ => {
            a_place == b_place || is_partial_of(a_place, b_place) || is_partial_of(b_place, a_place)
        }
    }
}

fn file_meets_folder(file: &Path, folder: &Path, names: &[String]) -> bool {
    // The folder cannot be where the file is, nor below it.
    folder.starts_with(file)
        || file == folder.join(LISTING_NAME)
        || names.iter().any(|name| {
            let written = folder.join(name);
            file == written || is_partial_of(file, &written)
        })
}

/// Whether `path` is where the beginning of `whole` may be kept while that is written.
fn is_partial_of(path: &Path, whole: &Path) -> bool {
    let (Some(name), Some(whole_name)) = (path.file_name(), whole.file_name()) else {
        return false;
    };
    let partial = [whole_name.as_encoded_bytes(), PARTIAL_ENDING.as_bytes()].concat();
    let numbered = name.as_encoded_bytes().strip_prefix(partial.as_slice());
    folder_of(path) == folder_of(whole)
        && numbered.is_some_and(|number| number.is_empty() || number.starts_with(b"-"))
}

/// The path without links and `..`, also if there is nothing yet.
fn resolved(path: &Path) -> PathBuf {
    resolved_within(path, MAX_LINKS)
}

fn resolved_within(path: &Path, links_left: usize) -> PathBuf {
    if let Ok(there) = fs::canonicalize(path) {
        return there;
    }
    let Some(name) = path.file_name() else {
        // It ends in `..`, below a folder that is not there.
        return match path.parent() {
            Some(below) if below.file_name().is_some() => {
                folder_of(&resolved_within(below, links_left)).to_owned()
            }
            _ => path.to_owned(),
        };
    };
    let folder = folder_of(path);
    match fs::read_link(path) {
        Ok(link) if links_left > 0 => resolved_within(&folder.join(link), links_left - 1),
        _ => resolved_within(folder, links_left).join(name),
    }
}

#[cfg(unix)]
fn is_character_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    fs::metadata(path).is_ok_and(|metadata| metadata.file_type().is_char_device())
}

#[cfg(not(unix))]
fn is_character_device(_: &Path) -> bool {
    false
}
