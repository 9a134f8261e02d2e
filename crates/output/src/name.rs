//! File names from any text.

/// Longest name that is made, bytes: leaves room for endings.
const MAX_LEN: usize = 120;

/// A file name from any text, such as a path in a table: separators, control characters and what some systems do not
/// allow become `_`, leading dots go, a long text is cut.
///
/// Different texts may give the same name.
///
/// ```
/// use grimnet_output::file_name_from;
/// assert_eq!(file_name_from("sub/a b.jpg"), "sub_a b.jpg");
/// assert_eq!(file_name_from("/etc/passwd"), "etc_passwd");
/// assert_eq!(file_name_from("../../x"), "x");
/// assert_eq!(file_name_from(" .x"), "x");
/// assert_eq!(file_name_from(""), "unnamed");
/// ```
#[must_use]
pub fn file_name_from(text: &str) -> String {
    let mut name = String::new();
    for part in text.split(['/', '\\']) {
        if part.is_empty() || part.chars().all(|c| c == '.') {
            continue;
        }
        if !name.is_empty() {
            name.push('_');
        }
        name.extend(part.chars().map(|c| {
            if c.is_control() || ":*?\"<>|".contains(c) {
                '_'
            } else {
                c
            }
        }));
    }
    let name = name
        .trim_start_matches(|c: char| c == '.' || c.is_whitespace())
        .trim_end();
    let mut end = name.len().min(MAX_LEN);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    match &name[..end] {
        "" => "unnamed".to_owned(),
        name => name.to_owned(),
    }
}
