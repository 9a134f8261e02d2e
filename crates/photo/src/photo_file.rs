//! Reading the bytes of a photo file, at most as many as the limits allow.

use std::io::Read as _;
use std::path::Path;

use grimnet_limits::PhotoLimits;

use crate::error::PhotoError;

/// Reads a whole photo file, for [`Photo::from_bytes_within`](crate::Photo::from_bytes_within). The limit is checked before and while
/// reading: the size that a file states may be wrong (`/proc`, growing files).
///
/// # Errors
/// [`PhotoError::Read`]; [`PhotoError::NotRegular`]; [`PhotoError::FileTooLarge`] if the file alone is larger than a photo may take in memory.
pub fn read_photo_file(path: &Path, limits: &PhotoLimits) -> Result<Vec<u8>, PhotoError> {
    let limit_bytes = limits.max_memory_bytes;
    let too_large = |bytes| PhotoError::FileTooLarge {
        path: path.to_owned(),
        bytes,
        limit_bytes,
    };
    let unreadable = |source| PhotoError::Read {
        path: path.to_owned(),
        source,
    };
    // Looked at before it is opened: opening a FIFO waits for a writer, and some devices act on being opened.
    if !std::fs::metadata(path).map_err(unreadable)?.is_file() {
        return Err(PhotoError::NotRegular {
            path: path.to_owned(),
        });
    }
    let file = fs_err::File::open(path).map_err(unreadable)?;
    let stated = file.metadata().map_err(unreadable)?.len();
    if stated > limit_bytes {
        return Err(too_large(stated));
    }
    let mut bytes = Vec::with_capacity(stated as usize + 1);
    file.take(limit_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    if bytes.len() as u64 > limit_bytes {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn pipes_are_refused_and_never_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo.jpg");
        let made = std::process::Command::new("mkfifo").arg(&fifo).status();
        assert!(made.unwrap().success());
        for path in [fifo.as_path(), folder.path(), Path::new("/dev/zero")] {
            let error = read_photo_file(path, &PhotoLimits::DEFAULT).unwrap_err();
            assert!(matches!(error, PhotoError::NotRegular { .. }), "{error}");
        }
    }
}
