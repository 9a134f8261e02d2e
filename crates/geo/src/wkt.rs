//! Coordinate systems as well-known text, by their EPSG code.

use std::path::Path;

use crate::{Crs, GeoError};

/// Roots of coordinate systems of the plane and of the ellipsoid, WKT 1 and 2.
const SYSTEMS: [&str; 6] = [
    "PROJCS[",
    "PROJCRS[",
    "GEOGCS[",
    "GEOGCRS[",
    "GEODCRS[",
    "GEODETICCRS[",
];

/// The coordinate system that a text names: `EPSG:CODE`, a PROJ string, or well-known text with the authority's code.
/// `None` if well-known text has no code. `path` is the file that the text is in.
pub(crate) fn crs_from_text(text: &str, path: &Path) -> Result<Option<Crs>, GeoError> {
    let text = text.trim();
    let crs = if text.contains('[') {
        epsg_of_wkt(text).map(Crs::from_epsg).transpose()
    } else {
        Crs::parse(text).map(Some)
    };
    crs.map_err(|error| match error {
        GeoError::UnknownCrs { crs, reason } => GeoError::UnsupportedCrs {
            path: path.to_path_buf(),
            crs,
            reason,
        },
        other => other,
    })
}

/// The EPSG code of the outermost system: `AUTHORITY["EPSG","25832"]` or `ID["EPSG",25832]` directly in it.
fn epsg_of_wkt(text: &str) -> Option<u32> {
    let start = SYSTEMS.iter().filter_map(|s| text.find(s)).min()?;
    let mut depth = 0_usize;
    let mut quoted = false;
    let mut word_start = start;
    for (at, character) in text[start..].char_indices() {
        let at = start + at;
        match character {
            '"' => quoted = !quoted,
            _ if quoted => {}
            '[' => {
                let word = text[word_start..at].trim();
                if depth == 1 && (word == "AUTHORITY" || word == "ID") {
                    let rest = &text[at + 1..];
                    let inside = &rest[..rest.find(']')?];
                    let (name, code) = inside.split_once(',')?;
                    if name.trim().trim_matches('"') == "EPSG" {
                        let code = code.split(',').next()?.trim().trim_matches('"');
                        return code.parse().ok();
                    }
                }
                depth += 1;
                word_start = at + 1;
            }
            ']' => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return None;
                }
                word_start = at + 1;
            }
            ',' => word_start = at + 1,
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_is_that_of_the_outermost_system() {
        let utm = r#"PROJCS["WGS 84 / UTM, [zone] 32N",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],UNIT["m",1],AUTHORITY["EPSG","32632"]]"#;
        assert_eq!(epsg_of_wkt(utm), Some(32632));
        let wkt2 = r#"PROJCRS["x", BASEGEOGCRS["WGS 84", ID["EPSG", 4326]], ID["EPSG", 25832]]"#;
        assert_eq!(epsg_of_wkt(wkt2), Some(25832));
        let compound = r#"COMPD_CS["x",PROJCS["p",GEOGCS["g",AUTHORITY["EPSG","4258"]],AUTHORITY["EPSG","25833"]],VERT_CS["v",AUTHORITY["EPSG","7837"]],AUTHORITY["EPSG","1"]]"#;
        assert_eq!(epsg_of_wkt(compound), Some(25833));
        let without = r#"PROJCS["own",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],UNIT["m",1]]"#;
        assert_eq!(epsg_of_wkt(without), None);
        for broken in [
            "PROJCS[",
            "PROJCS[]]]",
            "PROJCS[\"",
            "]",
            "PROJCS[AUTHORITY[",
            "PROJCS[ID[]",
        ] {
            assert_eq!(epsg_of_wkt(broken), None, "{broken}");
        }
    }
}
