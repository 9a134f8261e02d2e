//! Text from a pack as it may be printed.

use std::fmt;

/// Text with control characters and characters that change the writing direction escaped: a pack comes from anywhere,
/// and its text must not control the terminal it is printed on.
pub(crate) struct Printable<'a>(pub &'a str);

impl fmt::Display for Printable<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_plain = |c: char| {
            let is_direction = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
            !c.is_control() && !is_direction && !matches!(c, '\u{2028}' | '\u{2029}')
        };
        for c in self.0.chars() {
            if is_plain(c) {
                write!(f, "{c}")?;
            } else {
                write!(f, "{}", c.escape_default())?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_the_rest_is_kept() {
        let text = Printable("Größe 東京\u{1b}[2J\n\u{202e}\u{7}").to_string();
        assert_eq!(text, "Größe 東京\\u{1b}[2J\\n\\u{202e}\\u{7}");
    }
}
