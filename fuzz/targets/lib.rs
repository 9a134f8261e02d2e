//! What the targets share: a file in memory, since most readers take paths.

use std::path::PathBuf;
use std::sync::OnceLock;

/// Writes the bytes to the file of this process, in memory where the system has such a folder, and gives its path.
pub fn file_of(bytes: &[u8], name: &str) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let memory = PathBuf::from("/dev/shm");
        let parent = if memory.is_dir() {
            memory
        } else {
            std::env::temp_dir()
        };
        let folder = parent.join(format!("grimnet-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        folder
    });
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Panics unless the error names the file.
pub fn assert_named(error: &dyn std::error::Error, name: &str) {
    assert!(error.to_string().contains(name), "{error}");
}
