//! Text of files for a line of output.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Text of a file (a name, a pack's metadata) for one line of output: control characters, which could steer the
/// terminal, and characters that reorder text are escaped, as `\u{1b}`.
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |_| false)
}

/// As [`printable`], for text of several lines: line breaks and tabs stay.
pub fn printable_text(text: &str) -> Cow<'_, str> {
    escaped(text, |c| c == '\n' || c == '\t')
}

fn escaped(text: &str, keep: fn(char) -> bool) -> Cow<'_, str> {
    let steers = |c: char| steers(c) && !keep(c);
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let mut clean = String::with_capacity(text.len());
    for c in text.chars() {
        if steers(c) {
            // Writing to a string does not fail.
            let _ = write!(clean, "{}", c.escape_unicode());
        } else {
            clean.push(c);
        }
    }
    Cow::Owned(clean)
}

/// Control characters (C0, DEL, C1), bidirectional formatting (Unicode UAX 9), and what XML 1.0 cannot hold.
fn steers(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{fffe}' | '\u{ffff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_steers_the_terminal() {
        assert_eq!(printable("flight/ä b.jpg"), "flight/ä b.jpg");
        assert_eq!(printable("\x1b[31mred\n"), "\\u{1b}[31mred\\u{a}");
        assert_eq!(printable("\u{9b}2J\u{202e}gpj"), "\\u{9b}2J\\u{202e}gpj");
        assert_eq!(printable("a\u{fffe}\u{ffff}"), "a\\u{fffe}\\u{ffff}");
        assert_eq!(printable_text("a\tb\n\x07"), "a\tb\n\\u{7}");
    }
}
