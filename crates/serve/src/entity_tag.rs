//! Whether a client has what it asks for: entity tags (RFC 9110, 13.1.2).

use axum::http::{HeaderMap, HeaderValue, header};

/// Whether `If-None-Match` names the entity tag. The comparison is weak: proxies that compress mark tags as weak.
pub(crate) fn is_known(headers: &HeaderMap, tag: &HeaderValue) -> bool {
    let values = headers.get_all(header::IF_NONE_MATCH);
    let texts = values.iter().filter_map(|value| value.to_str().ok());
    // Our tags hold no comma.
    texts.flat_map(|text| text.split(',')).any(|element| {
        let element = element.trim();
        element == "*" || element.strip_prefix("W/").unwrap_or(element) == tag
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_are_compared_weakly() {
        let tag = HeaderValue::from_static("\"abc\"");
        let known = |text: &'static str| {
            let mut headers = HeaderMap::new();
            headers.insert(header::IF_NONE_MATCH, HeaderValue::from_static(text));
            is_known(&headers, &tag)
        };
        for yes in ["\"abc\"", "W/\"abc\"", "\"x\", W/\"abc\" , \"y\"", "*"] {
            assert!(known(yes), "{yes}");
        }
        for no in ["", "abc", "\"abcd\"", "\"x\", \"y\"", "W/*"] {
            assert!(!known(no), "{no}");
        }
        assert!(!is_known(&HeaderMap::new(), &tag));
    }
}
