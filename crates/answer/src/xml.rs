//! What the XML formats share.

use quick_xml::Writer;
use quick_xml::events::BytesText;

use crate::answer::Answer;
use crate::format::{heading_or_dash, or_dash};
use crate::printable::printable_text;

pub(crate) type Xml<'w> = &'w mut Writer<Vec<u8>>;

/// An element that holds text. XML 1.0 cannot hold control characters, escaped or not.
pub(crate) fn leaf(xml: Xml, name: &str, text: &str) -> std::io::Result<()> {
    xml.create_element(name)
        .write_text_content(BytesText::new(&printable_text(text)))?;
    Ok(())
}

/// The text that `write` wrote, indented.
pub(crate) fn written(write: impl FnOnce(Xml) -> std::io::Result<()>) -> std::io::Result<String> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 1);
    write(&mut xml)?;
    let text = String::from_utf8(xml.into_inner()).map_err(std::io::Error::other)?;
    Ok(text + "\n")
}

/// One answer in words.
pub(crate) fn description(answer: &Answer) -> String {
    match (answer.lon_deg.zip(answer.lat_deg), &answer.reason) {
        (Some(_), _) => {
            let check = answer.check_m.map_or_else(String::new, |check_m| {
                format!(", {check_m:.1} m from the position in its metadata")
            });
            format!(
                "heading {} degrees, 95 % radius {} m, {} inliers{check}",
                heading_or_dash(answer.heading_deg),
                or_dash(answer.radius95_m, 1),
                answer.inliers.unwrap_or(0)
            )
        }
        (None, Some(reason)) => format!("no fix: {reason}"),
        (None, None) => "no fix".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_is_below_a_full_turn_with_fewer_decimals_too() {
        let answer = Answer {
            lat_deg: Some(24.0),
            lon_deg: Some(120.0),
            heading_deg: Some(359.98),
            ..Answer::default()
        };
        assert!(description(&answer).starts_with("heading 0.0 degrees,"));
    }
}
