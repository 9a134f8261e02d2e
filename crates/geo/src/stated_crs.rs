//! What a file says of its coordinate system as text.

use std::path::Path;

use crate::wkt::WktNode;
use crate::wkt_definition::crs_of_definition;
use crate::{Crs, GeoError};

/// Characters of a text that an error quotes, at most.
const MAX_QUOTED: usize = 60;

/// The coordinate system that a file states.
#[expect(
    clippy::large_enum_variant,
    reason = "a map has few of them, and a box would be in the way of every match"
)]
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) enum StatedCrs {
    /// None.
    #[default]
    Absent,
    /// One that is known.
    Known(Crs),
    /// One that is not: it must not be taken for another one.
    Unknown {
        /// Its name, or the text.
        name: String,
        /// Why it is not known.
        reason: String,
    },
}

impl StatedCrs {
    /// The coordinate system of a text: `EPSG:CODE`, a PROJ string, or well-known text, of which the EPSG code counts where it has one.
    pub fn from_text(text: &str) -> Self {
        let text = text.trim();
        if text.is_empty() {
            return Self::Absent;
        }
        if !text.contains('[') {
            return match Crs::parse(text) {
                Ok(crs) => Self::Known(crs),
                Err(error) => Self::unknown(text, error),
            };
        }
        let root = WktNode::parse(text);
        let Some(system) = root.as_ref().and_then(WktNode::system) else {
            return Self::Unknown {
                name: quoted(text),
                reason: "not a system of the plane or of the ellipsoid".to_string(),
            };
        };
        let name = system.text(0).unwrap_or(text);
        if let Some(code) = system.epsg() {
            return match Crs::from_epsg(code) {
                Ok(crs) => Self::Known(crs),
                Err(error) => Self::unknown(name, error),
            };
        }
        match crs_of_definition(system) {
            Ok(crs) => Self::Known(crs),
            Err(reason) => Self::Unknown {
                name: quoted(name),
                reason: format!("not supported: {reason}"),
            },
        }
    }

    fn unknown(name: &str, error: GeoError) -> Self {
        let reason = match error {
            GeoError::UnknownCrs { reason, .. } => reason,
            other => other.to_string(),
        };
        Self::Unknown {
            name: quoted(name),
            reason,
        }
    }

    /// The coordinate system, if it is known.
    pub fn known(&self) -> Option<&Crs> {
        match self {
            Self::Known(crs) => Some(crs),
            Self::Absent | Self::Unknown { .. } => None,
        }
    }

    /// The coordinate system that the file at `path` states, `None` if it states none.
    ///
    /// # Errors
    /// Returns [`GeoError::UnsupportedCrs`] if it is not known.
    pub fn in_file(self, path: &Path) -> Result<Option<Crs>, GeoError> {
        match self {
            Self::Absent => Ok(None),
            Self::Known(crs) => Ok(Some(crs)),
            Self::Unknown { name, reason } => Err(GeoError::UnsupportedCrs {
                path: path.to_path_buf(),
                crs: name,
                reason,
            }),
        }
    }
}

/// The beginning of a text.
fn quoted(text: &str) -> String {
    match text.char_indices().nth(MAX_QUOTED) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}
