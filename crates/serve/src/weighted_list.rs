//! Headers that list what a client takes, with weights such as `gzip;q=0.5` (RFC 9110, 12.4.2).

use axum::http::{HeaderMap, HeaderName};

/// The elements of all headers `name` in lower case, each with its weight: 0 to 1, and 0 if it is not understood.
pub(crate) fn weighted_list(headers: &HeaderMap, name: HeaderName) -> Vec<(String, f32)> {
    let values = headers.get_all(name);
    let texts = values.iter().filter_map(|value| value.to_str().ok());
    texts
        .flat_map(|text| text.split(','))
        .map(|element| element.trim().to_ascii_lowercase())
        .filter(|element| !element.is_empty())
        .map(|element| {
            let mut parts = element.split(';').map(str::trim);
            let name = parts.next().unwrap_or_default().to_owned();
            let weight = parts
                .find_map(|part| part.strip_prefix("q="))
                .map_or(1.0, |q| q.parse::<f32>().unwrap_or(0.0));
            let is_weight = (0.0..=1.0).contains(&weight);
            (name, if is_weight { weight } else { 0.0 })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use axum::http::header::ACCEPT;

    use super::*;

    #[test]
    fn elements_have_weights() {
        let mut headers = HeaderMap::new();
        headers.append(ACCEPT, "Text/CSV;Q=0.5 , a/b; v=1; q=0".parse().unwrap());
        headers.append(ACCEPT, ",c/d, e/f;q=x, g/h;q=nan, i/j;q=2".parse().unwrap());
        let expected = [
            ("text/csv", 0.5),
            ("a/b", 0.0),
            ("c/d", 1.0),
            ("e/f", 0.0),
            ("g/h", 0.0),
            ("i/j", 0.0),
        ];
        let expected = expected.map(|(name, weight)| (name.to_owned(), weight));
        assert_eq!(weighted_list(&headers, ACCEPT), expected);
    }
}
