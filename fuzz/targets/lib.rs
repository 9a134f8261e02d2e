//! What the targets share: files in memory, since most readers take paths, and what holds of every map that opens.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

#[path = "../../crates/geo/tests/support/usable.rs"]
pub mod usable;

/// The folder of this process, in memory where the system has such a folder.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let memory = PathBuf::from("/dev/shm");
        let parent = if memory.is_dir() {
            memory
        } else {
            std::env::temp_dir()
        };
        let folder = parent.join(format!("grimnet-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    })
}

/// Writes the bytes to a file of this process, and gives its path.
pub fn file_of(bytes: &[u8], name: &str) -> PathBuf {
    let path = folder().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Panics unless the error names the file.
pub fn assert_named(error: &dyn std::error::Error, name: &str) {
    assert!(error.to_string().contains(name), "{error}");
}
