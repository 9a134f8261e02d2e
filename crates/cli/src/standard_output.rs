//! Standard output that is named in its errors.

use std::io::{self, Write};

/// Standard output; its errors say that it is what cannot be written.
#[derive(Debug, Clone, Copy)]
pub struct StandardOutput;

impl Write for StandardOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        io::stdout().write(bytes).map_err(named)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stdout().flush().map_err(named)
    }
}

/// The kind stays, by which a reader that went away is distinguished from other errors.
fn named(error: io::Error) -> io::Error {
    let kind = error.kind();
    if kind == io::ErrorKind::Interrupted {
        return error;
    }
    io::Error::new(kind, format!("cannot write to standard output: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_keep_their_kind() {
        let error = named(io::ErrorKind::StorageFull.into());
        assert!(
            error
                .to_string()
                .starts_with("cannot write to standard output: ")
        );
        let gone = anyhow::Error::new(named(io::ErrorKind::BrokenPipe.into()));
        assert!(crate::errors::is_broken_pipe(&gone));
    }
}
