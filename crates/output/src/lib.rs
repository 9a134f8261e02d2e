//! Writes files so that a kill, a full disk or a wrong path loses nothing.
//!
//! Two rules hold for every file that a program writes through this crate:
//!
//! 1. **A file is replaced as a whole or not at all.** [`AtomicFile`] and [`write_atomic`] write a temporary file in the
//!    same folder, sync it to disk and rename it. Devices and pipes (`/dev/null`, `/dev/stdout`, a FIFO) are written
//!    through and never renamed over.
//! 2. **Only own files are replaced.** [`OutputPolicy`] refuses to replace an input of the same run, always, also one
//!    that becomes known while the output is written, and any other existing file that the program did not write, unless
//!    overwriting was allowed. A file is the program's own
//!    if it starts with one of the magic numbers that the caller names, or if the list `.grim-output` of its folder
//!    holds its name together with the BLAKE3 hash of its present content. [`OutputFolder`] keeps that list.
//!
//! [`Journal`] keeps the results of long work so far, so that a run that was stopped goes on.
//!
//! [`check_apart`] refuses outputs of one run that would be written to the same place, before any of them is.
//!
//! ```
//! use grimnet_output::{OutputError, OutputFolder, OutputPolicy};
//! use std::io::Write as _;
//!
//! # let parent = tempfile::tempdir().unwrap();
//! # let path = parent.path().join("results");
//! let policy = OutputPolicy::new().protect("map.tif");
//! let folder = OutputFolder::open(&path, &policy)?;
//! folder.check(["summary.json"])?; // before hours of work
//! folder.write("summary.json", |file| writeln!(file, "{{}}"))?;
//! folder.write("summary.json", |file| writeln!(file, "[]"))?; // own: replaced
//!
//! std::fs::write(path.join("notes.txt"), "mine").unwrap();
//! let refused = folder.write("notes.txt", |file| writeln!(file, "lost"));
//! assert!(matches!(refused, Err(OutputError::NotOwn { .. })));
//! # Ok::<(), OutputError>(())
//! ```

mod aside;
mod atomic;
mod error;
mod folder;
mod inputs;
mod journal;
mod listing;
mod name;
mod planned;
mod policy;
mod target;

pub use atomic::{AtomicFile, rename_into_place, write_atomic, write_bytes_atomic};
pub use error::{OutputError, Result};
pub use folder::{FolderFile, OutputFolder};
pub use journal::{Journal, RecordPlace};
pub use listing::LISTING_NAME;
pub use name::file_name_from;
pub use planned::{PlannedOutput, check_apart};
pub use policy::OutputPolicy;
pub use target::{Snapshot, TargetKind, linked_path};
