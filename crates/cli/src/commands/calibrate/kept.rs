//! The observations of a run so far, beside the model that it will write: the same command goes on from them.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::Result;
use grimnet_eval::calibration::observation::{self, Observation};
use grimnet_output::{Journal, OutputPolicy, TargetKind, linked_path};

/// Kind of a record: an observation, as a line of CSV.
const OBSERVATION: u32 = 2;

/// The file that observations are kept in: `OUT.partial`, as other unfinished work is. `None` for a device or pipe, which has no place
/// beside it.
///
/// # Errors
/// The output cannot be examined, or an input of the run has that name.
pub fn path_for(out: &Path, policy: &OutputPolicy) -> Result<Option<PathBuf>> {
    if TargetKind::of(out)? == TargetKind::Stream {
        return Ok(None);
    }
    let mut name = OsString::from(linked_path(out)?);
    name.push(".partial");
    let path = PathBuf::from(name);
    policy.check_not_input(&path)?;
    Ok(Some(path))
}

/// The file that is being written.
pub struct Kept {
    journal: Journal,
    path: PathBuf,
    count: usize,
}

impl Kept {
    /// Opens the file, and gives the observations in it that were made under the same `conditions`. Others are given up.
    ///
    /// # Errors
    /// Another run writes to it, it is not of this program, or it cannot be written.
    pub fn open(path: &Path, out: &Path, conditions: &str) -> Result<(Self, Vec<Observation>)> {
        let mut earlier = Vec::new();
        let fingerprint = blake3::hash(conditions.as_bytes()).to_hex();
        let journal = Journal::open(path, out, &fingerprint, |kind, _, line| {
            let read = (kind == OBSERVATION).then(|| observation::of_line(line));
            let read = read.flatten();
            let is_read = read.is_some();
            earlier.extend(read);
            is_read
        })?;
        let kept = Self {
            journal,
            path: path.to_owned(),
            count: earlier.len(),
        };
        Ok((kept, earlier))
    }

    /// Keeps an observation.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add(&mut self, observation: &Observation) -> std::io::Result<()> {
        let line = observation::line(observation)?;
        let added = self.journal.append(OBSERVATION, &line);
        added.map_err(std::io::Error::other)?;
        self.count += 1;
        Ok(())
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How many observations it holds.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Deletes the file, when it is of no use any more.
    ///
    /// # Errors
    /// It cannot be deleted.
    pub fn remove(self) -> Result<()> {
        Ok(self.journal.remove()?)
    }
}

/// A file that observations depend on, in words that change when it does. One that cannot be read says so when it is used.
pub fn state_of(path: &Path) -> String {
    let metadata = fs_err::metadata(path).ok();
    let state = metadata.map(|metadata| (metadata.len(), metadata.modified().ok()));
    format!("{path:?} {state:?}\n")
}
