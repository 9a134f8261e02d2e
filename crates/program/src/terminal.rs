//! Colours only where they are wanted.

use std::ffi::OsString;
use std::io::IsTerminal;

/// Whether what is written to `stream` may be coloured: on a terminal that has colours, unless `NO_COLOR` is set
/// (<https://no-color.org>).
pub fn has_colours(stream: &impl IsTerminal) -> bool {
    stream.is_terminal() && is_wanted(|name| std::env::var_os(name))
}

/// Whether the environment asks for colours. Terminals of the kind `dumb`, such as the shell of Emacs, show their codes as text.
fn is_wanted(variable: impl Fn(&str) -> Option<OsString>) -> bool {
    let is_unwanted = variable("NO_COLOR").is_some_and(|value| !value.is_empty());
    !is_unwanted && variable("TERM").is_none_or(|kind| kind != "dumb")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_colours_where_they_are_unwanted_or_shown_as_text() {
        for (no_color, term, expected) in [
            (None, Some("xterm-256color"), true),
            (Some(""), None, true),
            (Some("1"), Some("xterm-256color"), false),
            (None, Some("dumb"), false),
        ] {
            let variable = |name: &str| {
                let value = if name == "TERM" { term } else { no_color };
                value.map(OsString::from)
            };
            assert_eq!(is_wanted(variable), expected, "{no_color:?} {term:?}");
        }
    }
}
