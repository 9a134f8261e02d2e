//! The results of long work so far, in a file beside its output that is only appended to.
//!
//! Each record carries a checksum over its kind, length and content. A killed process leaves complete records and
//! possibly a part of one, which is cut off when the work continues. Records are not synced to disk: after a power cut
//! some may be lost or damaged, which the checksums detect as well.

use std::fs::{File, TryLockError};
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::{OutputError, Result};

const MAGIC: [u8; 4] = *b"GJR1";
const HEAD_LEN: usize = 32;

/// Kind of the first record, whose content is the fingerprint of the work. Those of its results are the caller's, from 2 on.
const START: u32 = 1;

/// The place of a record's content in the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordPlace {
    /// Start of the content, bytes.
    pub offset: u64,
    /// Length of the content, bytes.
    pub len: u64,
}

/// A locked journal, positioned at its end.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    end: u64,
}

impl Journal {
    /// Opens or creates the journal at `path`, locks it, and calls `each` with kind, place and content of each valid record of
    /// the same work. If `each` returns `false`, this record and the rest are cut off. A journal of other work (another
    /// `fingerprint`, which stands for all that the results depend on) is emptied.
    ///
    /// # Errors
    /// [`OutputError::Busy`] if another process holds the journal (`output` is named in the message),
    /// [`OutputError::InTheWay`] if something else than a journal is there, and [`OutputError::Io`].
    pub fn open(
        path: &Path,
        output: &Path,
        fingerprint: &str,
        mut each: impl FnMut(u32, RecordPlace, &[u8]) -> bool,
    ) -> Result<Self> {
        let file = lock(path, output)?;
        let len = file
            .metadata()
            .map_err(OutputError::io("read", path))?
            .len();
        check_own(&file, path)?;
        let mut reader = BufReader::with_capacity(1 << 20, &file);
        let mut content = Vec::new();
        let mut end = 0;
        while let Some(kind) = next_record(&mut reader, len - end, &mut content) {
            let place = RecordPlace {
                offset: end + HEAD_LEN as u64,
                len: content.len() as u64,
            };
            let is_first = end == 0;
            let wanted = match (is_first, kind) {
                (true, START) => content == fingerprint.as_bytes(),
                (false, kind) if kind != START => each(kind, place, &content),
                _ => false,
            };
            if !wanted {
                if is_first {
                    tracing::warn!(
                        journal = %path.display(),
                        "the unfinished work here has other inputs or options; starting from the beginning"
                    );
                }
                break;
            }
            end = place.offset + place.len;
        }
        drop(reader);
        file.set_len(end)
            .and_then(|()| (&file).seek(SeekFrom::Start(end)))
            .map_err(OutputError::io("write", path))?;
        let mut journal = Self {
            path: path.to_path_buf(),
            file,
            end,
        };
        if end == 0 {
            journal.append(START, fingerprint.as_bytes())?;
        }
        Ok(journal)
    }

    /// Appends a record.
    ///
    /// # Errors
    /// [`OutputError::Io`]; the journal stays valid up to the record before.
    pub fn append(&mut self, kind: u32, content: &[u8]) -> Result<RecordPlace> {
        let mut record = Vec::with_capacity(HEAD_LEN + content.len());
        record.extend_from_slice(&head(kind, content));
        record.extend_from_slice(content);
        self.file
            .write_all(&record)
            .map_err(OutputError::io("write", &self.path))?;
        let place = RecordPlace {
            offset: self.end + HEAD_LEN as u64,
            len: content.len() as u64,
        };
        self.end = place.offset + place.len;
        Ok(place)
    }

    /// Reads `len` bytes at `offset`, as given by a [`RecordPlace`]. Nothing may be appended afterwards.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn read(&mut self, offset: u64, len: usize, into: &mut Vec<u8>) -> Result<()> {
        into.resize(len, 0);
        self.file
            .seek(SeekFrom::Start(offset))
            .and_then(|_| self.file.read_exact(into))
            .map_err(OutputError::io("read", &self.path))
    }

    /// Deletes the journal, once the output is in place.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(OutputError::io("delete", &self.path))
    }

    /// Deletes the journal of finished work that was killed between renaming its output and deleting it. A journal of other work, or
    /// one that another process holds, stays.
    pub fn remove_finished(path: &Path, fingerprint: &str) {
        if check_plain(path).is_err() {
            return;
        }
        let Ok(file) = File::open(path) else { return };
        let len = file.metadata().map_or(0, |metadata| metadata.len());
        let mut content = Vec::new();
        let first = next_record(&mut BufReader::new(&file), len, &mut content);
        let is_of_this_work = first == Some(START) && content == fingerprint.as_bytes();
        if is_of_this_work && file.try_lock().is_ok() {
            // The output is there: what is left does no harm.
            let _ = std::fs::remove_file(path);
        }
    }
}

fn in_the_way(path: &Path, why: &'static str) -> OutputError {
    OutputError::InTheWay {
        path: path.to_path_buf(),
        why,
    }
}

/// Refuses what is there but no file: a link leads to a file of somebody else, and opening a pipe blocks.
fn check_plain(path: &Path) -> Result<()> {
    match std::fs::symlink_metadata(path) {
        Ok(metadata) if !metadata.is_file() => {
            Err(in_the_way(path, "it is a link, a folder or a device"))
        }
        _ => Ok(()),
    }
}

/// Refuses a file that is not a journal, or that has another name elsewhere. Work that was killed at once leaves an
/// empty file or a part of the magic.
fn check_own(mut file: &File, path: &Path) -> Result<()> {
    let mut start = Vec::new();
    file.take(MAGIC.len() as u64)
        .read_to_end(&mut start)
        .and_then(|_| file.seek(SeekFrom::Start(0)))
        .map_err(OutputError::io("read", path))?;
    if !MAGIC.starts_with(&start) {
        return Err(in_the_way(path, "it does not hold unfinished work"));
    }
    let metadata = file.metadata().map_err(OutputError::io("read", path))?;
    if links(&metadata) > 1 {
        return Err(in_the_way(path, "it has a second name (a hard link)"));
    }
    Ok(())
}

/// Names of a file.
#[cfg(unix)]
fn links(metadata: &std::fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(metadata)
}

#[cfg(not(unix))]
fn links(_metadata: &std::fs::Metadata) -> u64 {
    1
}

/// Opens `path`, creating it if it is missing, and locks it without waiting.
fn lock(path: &Path, output: &Path) -> Result<File> {
    loop {
        check_plain(path)?;
        let file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(OutputError::io("create", path))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(OutputError::Busy {
                    path: output.to_path_buf(),
                });
            }
            // Some network file systems have no locks, and say so with different errors (NFS without a lock service: ENOLCK).
            Err(TryLockError::Error(error)) => {
                tracing::warn!(path = %path.display(), %error, "this file system cannot lock files; do not start a second run with the same output");
            }
        }
        // The holder may have finished and deleted the file between opening and locking: then this is a file without
        // a name, and the next process would not see the lock.
        if is_at(&file, path) {
            return Ok(file);
        }
    }
}

#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), std::fs::symlink_metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

/// On other systems an open file cannot be deleted.
#[cfg(not(unix))]
fn is_at(_file: &File, _path: &Path) -> bool {
    true
}

fn head(kind: u32, content: &[u8]) -> [u8; HEAD_LEN] {
    let mut head = [0; HEAD_LEN];
    head[..4].copy_from_slice(&MAGIC);
    head[4..8].copy_from_slice(&kind.to_le_bytes());
    head[8..16].copy_from_slice(&(content.len() as u64).to_le_bytes());
    let mut hasher = blake3::Hasher::new();
    hasher.update(&head[..16]);
    hasher.update(content);
    head[16..].copy_from_slice(&hasher.finalize().as_bytes()[..16]);
    head
}

/// The next record, or `None` if what follows is not a complete valid record.
fn next_record(reader: &mut impl Read, left: u64, content: &mut Vec<u8>) -> Option<u32> {
    let mut found = [0; HEAD_LEN];
    reader.read_exact(&mut found).ok()?;
    let word =
        |at: usize| u32::from_le_bytes([found[at], found[at + 1], found[at + 2], found[at + 3]]);
    let len = u64::from(word(8)) | u64::from(word(12)) << 32;
    if found[..4] != MAGIC || len > left.checked_sub(HEAD_LEN as u64)? {
        return None;
    }
    content.resize(len as usize, 0);
    reader.read_exact(content).ok()?;
    if head(word(4), content) != found {
        return None;
    }
    Some(word(4))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ITEM: u32 = 3;

    fn records(path: &Path, fingerprint: &str) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        Journal::open(path, path, fingerprint, |_, _, content| {
            all.push(content.to_vec());
            true
        })
        .unwrap();
        all
    }

    fn filled(path: &Path) {
        let mut journal = Journal::open(path, path, "a", |_, _, _| true).unwrap();
        for i in 0..5u8 {
            journal.append(ITEM, &vec![i; 10 * usize::from(i)]).unwrap();
        }
    }

    #[test]
    fn survives_being_cut_or_changed_at_any_byte() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j");
        filled(&path);
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(records(&path, "a").len(), 5);
        for at in 0..whole.len() {
            std::fs::write(&path, &whole[..at]).unwrap();
            let cut = records(&path, "a");
            assert!(
                cut.len() < 5
                    && cut
                        .iter()
                        .enumerate()
                        .all(|(i, r)| r == &vec![i as u8; 10 * i])
            );
            let mut changed = whole.clone();
            changed[at] ^= 0x40;
            std::fs::write(&path, &changed).unwrap();
            if at < MAGIC.len() {
                // Not known for a journal any more.
                refused(&path);
                continue;
            }
            let good = records(&path, "a");
            assert!(
                good.len() < 5
                    && good
                        .iter()
                        .enumerate()
                        .all(|(i, r)| r == &vec![i as u8; 10 * i])
            );
        }
    }

    /// Nothing changes at the path, nor behind it.
    fn refused(path: &Path) {
        let before = std::fs::read(path).unwrap();
        let error = Journal::open(path, path, "a", |_, _, _| true).unwrap_err();
        assert!(matches!(error, OutputError::InTheWay { .. }), "{error}");
        Journal::remove_finished(path, "a");
        assert_eq!(std::fs::read(path).unwrap(), before);
    }

    #[test]
    fn files_of_others_are_refused_and_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j");
        for notes in ["n", "GJR", "notes, more than a record's head is long"] {
            std::fs::write(&path, notes).unwrap();
            if notes == "GJR" {
                // What work may leave that is killed at once.
                records(&path, "a");
            } else {
                refused(&path);
            }
        }
    }

    #[test]
    #[cfg(unix)]
    fn links_are_refused_whatever_they_lead_to() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("j"), folder.path().join("other"));
        filled(&other);
        std::os::unix::fs::symlink(&other, &path).unwrap();
        refused(&path);
        std::fs::remove_file(&path).unwrap();
        std::fs::hard_link(&other, &path).unwrap();
        let error = Journal::open(&path, &path, "b", |_, _, _| true).unwrap_err();
        assert!(matches!(error, OutputError::InTheWay { .. }), "{error}");
        std::fs::remove_file(&path).unwrap();
        assert_eq!(records(&other, "a").len(), 5);
    }

    #[test]
    fn other_work_starts_from_the_beginning() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j");
        filled(&path);
        assert!(records(&path, "b").is_empty());
        assert!(records(&path, "a").is_empty(), "emptied");
    }

    #[test]
    fn continues_after_an_incomplete_record_and_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j");
        filled(&path);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 3]).unwrap();
        let mut journal = Journal::open(&path, &path, "a", |_, _, _| true).unwrap();
        let place = journal.append(ITEM, b"again").unwrap();
        let mut bytes = Vec::new();
        journal.read(place.offset + 1, 3, &mut bytes).unwrap();
        assert_eq!(bytes, b"gai");
        drop(journal);
        assert_eq!(records(&path, "a").last().unwrap(), b"again");
    }

    #[test]
    fn a_second_writer_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("j");
        let first = Journal::open(&path, &path, "a", |_, _, _| true).unwrap();
        let error = Journal::open(&path, Path::new("area.grim"), "a", |_, _, _| true).unwrap_err();
        assert!(
            matches!(error, OutputError::Busy { .. }) && error.to_string().contains("area.grim")
        );
        first.remove().unwrap();
        Journal::open(&path, &path, "a", |_, _, _| true).unwrap();
    }
}
