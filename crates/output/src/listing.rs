//! The list `.grim-output` of a folder: which files in it the program wrote, and with which content.
//!
//! ```text
//! # Files that grim wrote into this folder, by BLAKE3 hash. ...
//! HASH  NAME
//! ```
//! A name is listed before its file is renamed into place, so that a kill in between leaves no file that is not listed;
//! a name may therefore have several hashes. Those of contents that were replaced are dropped from time to time. In names, a backslash is written as `\\` and a line break as `\n`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use crate::atomic::{hash_of, write_bytes_atomic};
use crate::error::{OutputError, Result};

/// Name of the list in its folder.
pub const LISTING_NAME: &str = ".grim-output";

/// First line; a file that starts otherwise is not ours.
const HEADER: &str = "# Files that grim wrote into this folder, by BLAKE3 hash. It replaces or removes a file only while its content has that hash.\n";

/// Largest list that is read, bytes: some 600,000 files.
const MAX_LEN: u64 = 64 << 20;

/// So many hashes of replaced contents may be in the file before it is written again.
const MOST_OUTDATED: usize = 16;

/// A folder's list.
#[derive(Debug)]
pub(crate) struct Listing {
    path: PathBuf,
    hashes: BTreeMap<String, BTreeSet<String>>,
    /// Whether the file ends in the middle of a line, or does not exist.
    needs_writing: bool,
    /// Hashes in the file of contents that were replaced.
    outdated: usize,
}

impl Listing {
    /// Reads the list of a folder; an empty one if there is none.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(LISTING_NAME);
        let mut listing = Self {
            path: path.clone(),
            hashes: BTreeMap::new(),
            needs_writing: true,
            outdated: 0,
        };
        match fs::symlink_metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(listing),
            Err(error) => return Err(OutputError::io("examine", &path)(error)),
            Ok(metadata) if metadata.is_file() && metadata.len() <= MAX_LEN => {}
            Ok(_) => return Err(OutputError::NotOwn { path }),
        }
        let bytes = fs::read(&path).map_err(OutputError::io("read", &path))?;
        let text = String::from_utf8_lossy(&bytes);
        // A kill may have cut the first write off.
        if !text.starts_with(HEADER) && !HEADER.starts_with(&*text) {
            return Err(OutputError::NotOwn { path });
        }
        listing.needs_writing = !text.ends_with('\n');
        for line in text.lines().skip(1) {
            if let Some((hash, name)) = line.split_once("  ")
                && hash.len() == 2 * blake3::OUT_LEN
                && let Some(name) = unescaped(name)
            {
                listing.insert(name, hash.to_owned());
            }
        }
        Ok(listing)
    }

    fn insert(&mut self, name: String, hash: String) {
        self.hashes.entry(name).or_default().insert(hash);
    }

    /// Names that are listed.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.hashes.keys().map(String::as_str)
    }

    /// Whether the file `path`, under `name`, has a content that is listed.
    pub(crate) fn owns(&self, name: &str, path: &Path) -> Result<bool> {
        let Some(hashes) = self.hashes.get(name) else {
            return Ok(false);
        };
        let hash = File::open(path)
            .and_then(|mut file| hash_of(&mut file))
            .map_err(OutputError::io("read", path))?;
        Ok(hashes.contains(hash.to_hex().as_str()))
    }

    /// Lists a file, on disk when this returns.
    pub(crate) fn add(&mut self, name: &str, hash: blake3::Hash) -> Result<()> {
        let hash = hash.to_hex().to_string();
        if self
            .hashes
            .get(name)
            .is_some_and(|hashes| hashes.contains(&hash))
        {
            return Ok(());
        }
        let line = line(name, &hash);
        self.insert(name.to_owned(), hash);
        if self.needs_writing {
            return self.write();
        }
        let append = || {
            let mut file = OpenOptions::new().append(true).open(&self.path)?;
            file.write_all(line.as_bytes())?;
            file.sync_data()
        };
        append().map_err(OutputError::io("write", &self.path))
    }

    /// Forgets the earlier contents of a listed file that is in place now.
    pub(crate) fn settle(&mut self, name: &str, hash: blake3::Hash) {
        let in_place = BTreeSet::from([hash.to_hex().to_string()]);
        let listed = self.hashes.insert(name.to_owned(), in_place);
        self.outdated += listed.map_or(0, |hashes| hashes.len().saturating_sub(1));
        if self.outdated > MOST_OUTDATED {
            // A list that stays longer is right, too.
            let _ = self.write();
        }
    }

    /// Forgets the names that `keep` refuses.
    pub(crate) fn retain(&mut self, mut keep: impl FnMut(&str) -> bool) -> Result<()> {
        let before = self.hashes.len();
        self.hashes.retain(|name, _| keep(name));
        if self.hashes.len() == before {
            return Ok(());
        }
        self.write()
    }

    fn write(&mut self) -> Result<()> {
        let mut text = HEADER.to_owned();
        for (name, hashes) in &self.hashes {
            text.extend(hashes.iter().map(|hash| line(name, hash)));
        }
        write_bytes_atomic(&self.path, text.as_bytes())?;
        (self.needs_writing, self.outdated) = (false, 0);
        Ok(())
    }
}

fn line(name: &str, hash: &str) -> String {
    let name = name.replace('\\', "\\\\").replace('\n', "\\n");
    format!("{hash}  {name}\n")
}

fn unescaped(name: &str) -> Option<String> {
    let mut text = String::new();
    let mut rest = name.chars();
    while let Some(c) = rest.next() {
        text.push(match c {
            '\\' => match rest.next()? {
                'n' => '\n',
                '\\' => '\\',
                _ => return None,
            },
            c => c,
        });
    }
    Some(text)
}
