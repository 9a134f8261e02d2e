//! Colours only where they are wanted.

use std::io::IsTerminal as _;

/// Whether messages on standard error may be coloured: on a terminal, unless `NO_COLOR` is set (<https://no-color.org>).
pub fn colours_on_stderr() -> bool {
    let unwanted = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    std::io::stderr().is_terminal() && !unwanted
}
